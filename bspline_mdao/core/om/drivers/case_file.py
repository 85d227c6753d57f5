"""Rows of case files: counting them, and putting one run's rows before the next run's.

OpenMDAO reads these files and writes new ones; it has no function for either task.
"""

from __future__ import annotations

import os
import re
import sqlite3
import time
from bisect import bisect
from collections.abc import Iterator
from contextlib import closing, contextmanager

from ....errors import InputError

__all__ = ["COLUMNS", "Moment", "columns_of", "count_cases", "names_with_runs", "opened_cases", "take_over"]

Moment = tuple[float, str]
"""Time and name of a case or of a gradient."""

_CASE = ("id", "counter", "iteration_coordinate", "timestamp", "success", "msg")

COLUMNS = {
    "driver_iterations": (*_CASE, "inputs", "outputs", "residuals"),
    "driver_derivatives": (*_CASE, "derivatives"),
}
"""Columns of the tables recorded by a driver."""

_PLAIN = re.compile(r"\s*CREATE\s+(TABLE|(UNIQUE\s+)?INDEX)\s[\w\s\"'`\[\](),.]*", re.IGNORECASE)
_COMPUTED = re.compile(r"\b(AS|CHECK|DEFAULT|WHERE)\b", re.IGNORECASE)


@contextmanager
def opened_cases(
    file: str | os.PathLike,
) -> Iterator[sqlite3.Connection]:  # the file as it is; an unfinished write of a killed run is rolled back
    """Open an intact case file that contains only tables and indices, and so computes nothing."""
    if not os.path.isfile(file):
        raise InputError(f"{file}: there is no such case file")
    try:
        with closing(sqlite3.connect(file)) as connection:
            for kind, name, text in connection.execute("SELECT type, name, sql FROM sqlite_master"):
                is_plain = kind in ("table", "index") and (
                    text is None or (_PLAIN.fullmatch(text) and not _COMPUTED.search(text))
                )
                if not is_plain:
                    raise InputError(f"{file}: has the {kind} '{name}', which no recorder makes; it is not read")
            (said,) = connection.execute("PRAGMA quick_check(1)").fetchone()
            if said != "ok":
                raise sqlite3.DatabaseError(said)
            yield connection
    except sqlite3.Error as error:
        words = " ".join(str(error).split())[:160]
        raise InputError(f"{file}: is no case file that can be read ({words}); it may be damaged") from None


def columns_of(connection: sqlite3.Connection, table: str) -> set[str]:
    """Names of the columns of a table; none if the table does not exist."""
    return {row[1] for row in connection.execute(f"PRAGMA table_info({table})")}


def count_cases(file: str | os.PathLike) -> int:
    """Count the driver cases in a case file; none if the recorder had not begun or there is no file."""
    if not os.path.isfile(file):
        return 0
    (table, *_) = COLUMNS
    with opened_cases(file) as connection:
        if not columns_of(connection, table):
            return 0
        return int(connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0])


def take_over(
    connection: sqlite3.Connection,  # A case file without cases
    earlier: str | os.PathLike,  # the other file
) -> tuple[int, int]:  # number of cases; number of the driver's next iteration: cases may be missing
    """Copy the cases of another file into a new one, with times shifted as if they had ended just now."""
    with opened_cases(earlier):
        pass
    try:
        connection.execute("ATTACH ? AS earlier", (os.fspath(earlier),))
        here, there = (
            connection.execute(f"SELECT format_version FROM {of}.metadata").fetchone() for of in ("main", "earlier")
        )
        if here != there:
            raise InputError(
                f"{earlier}: was written by another version of OpenMDAO; start again, or run with that one"
            )
        with connection:
            for table, columns in COLUMNS.items():
                listed = ", ".join(columns)
                connection.execute(f"INSERT INTO main.{table}({listed}) SELECT {listed} FROM earlier.{table}")
            rows = "SELECT * FROM earlier.global_iterations WHERE record_type = 'driver'"
            connection.execute(f"INSERT INTO main.global_iterations {rows}")
            (table, *_) = COLUMNS
            (last,) = connection.execute(f"SELECT max(timestamp) FROM main.{table}").fetchone()
            shift = time.perf_counter() - (last or 0.0)
            for each in COLUMNS:
                connection.execute(f"UPDATE main.{each} SET timestamp = timestamp + ?, counter = id", (shift,))
        names = [name for (name,) in connection.execute(f"SELECT iteration_coordinate FROM main.{table}")]
        numbers = [int(name.rpartition("|")[2]) for name in names]
        connection.execute("DETACH earlier")
    except (sqlite3.Error, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{earlier}: its cases cannot be taken over ({error}); start again without them") from None
    return len(numbers), max(numbers, default=-1) + 1


def names_with_runs(cases: list[Moment], gradients: list[Moment]) -> tuple[list[str], list[str]]:
    """Names of cases and of gradients that distinguish the runs, each in its order."""
    # Every run of a driver numbers its cases from 0, and OpenMDAO reads only the first of equal names.
    runs: list[int] = []
    seen: set[str] = set()
    for _, name in cases:
        runs.append(runs[-1] + (name in seen) if runs else 0)
        seen = {name} if name in seen else seen | {name}
    times = [moment for moment, _ in cases]
    of_gradients = []
    for moment, name in gradients:  # each has the name of the next case, if there is one
        following = bisect(times, moment)
        is_there = following < len(cases) and cases[following][1] == name
        of_gradients.append(f"run{runs[following if is_there else max(following - 1, 0)]}_{name}")
    return [f"run{run}_{name}" for run, (_, name) in zip(runs, cases)], of_gradients
