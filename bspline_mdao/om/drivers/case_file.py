"""Rows of case files: how many there are, and how those of one run come before those of the next.

OpenMDAO reads these files, and writes new ones; it has no call for either.
"""

from __future__ import annotations

import os
import sqlite3
import tempfile
import time
from bisect import bisect
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from ...errors import InputError

__all__ = ["count_cases", "distinct_cases", "last_run", "take_over"]

TABLES = ("driver_iterations", "driver_derivatives")
"""Tables of what a driver has recorded."""

_Row = tuple[float, str, int]
"""Time, name and number of a row."""


def count_cases(file: str | os.PathLike) -> int:
    """Count the cases of a driver in a case file; there are none where a recorder had not begun, or is no file.

    Raises
    ------
    InputError
        If it is damaged, or no case file.
    """
    if not os.path.isfile(file):
        return 0
    try:
        with closing(sqlite3.connect(file)) as connection:
            known = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if TABLES[0] not in known:
                return 0
            return int(connection.execute(f"SELECT count(*) FROM {TABLES[0]}").fetchone()[0])
    except (sqlite3.Error, ValueError) as error:
        raise InputError(f"{file}: is no case file that can be read ({error}); it may be damaged") from None


def take_over(connection: sqlite3.Connection, earlier: str | os.PathLike) -> tuple[int, int]:
    """Put the cases of another file into a new one, with times as if they had ended just now.

    Parameters
    ----------
    connection : sqlite3.Connection
        A case file without cases.
    earlier : path-like
        The other file.

    Returns
    -------
    int
        Number of cases.
    int
        Number with which iterations of the driver go on: cases may be missing.

    Raises
    ------
    InputError
        If the other file cannot be read, or is of another version of OpenMDAO.
    """
    try:
        connection.execute("ATTACH ? AS earlier", (os.fspath(earlier),))
        here, there = (
            connection.execute(f"SELECT format_version FROM {of}.metadata").fetchone() for of in ("main", "earlier")
        )
        if here != there:
            raise InputError(f"{earlier}: was written by another version of OpenMDAO; begin anew, or run with that one")
        with connection:
            for table in TABLES:
                connection.execute(f"INSERT INTO main.{table} SELECT * FROM earlier.{table}")
            rows = "SELECT * FROM earlier.global_iterations WHERE record_type = 'driver'"
            connection.execute(f"INSERT INTO main.global_iterations {rows}")
            (last,) = connection.execute(f"SELECT max(timestamp) FROM main.{TABLES[0]}").fetchone()
            shift = time.perf_counter() - (last or 0.0)
            for table in TABLES:
                connection.execute(f"UPDATE main.{table} SET timestamp = timestamp + ?, counter = id", (shift,))
        names = [name for (name,) in connection.execute(f"SELECT iteration_coordinate FROM main.{TABLES[0]}")]
        numbers = [int(name.rpartition("|")[2]) for name in names]
        connection.execute("DETACH earlier")
    except (sqlite3.Error, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{earlier}: its cases cannot be taken over ({error}); begin anew") from None
    return len(numbers), max(numbers, default=-1) + 1


def last_run(file: str | os.PathLike) -> int | None:
    """Number of the last run of which a case file has the options of systems, from 0; None where it has none.

    Each ``run_model`` and ``run_driver`` of a problem is a run; a recorder that is attached later has nothing of the
    first ones.
    """
    with closing(sqlite3.connect(file)) as connection:
        names = [name for (name,) in connection.execute("SELECT id FROM system_metadata")]
    return max((int(name.partition("!")[2] or 0) for name in names), default=None)


@contextmanager
def distinct_cases(file: str | os.PathLike) -> Iterator[Path]:
    """A case file in which all cases of drivers have names of their own: the file, or else a copy of it for the while.

    Every run of a driver numbers its cases from 0, and of equal names OpenMDAO reads the first case alone.
    """
    with closing(sqlite3.connect(file)) as connection:
        columns = "SELECT timestamp, iteration_coordinate, id FROM"
        cases, gradients = (connection.execute(f"{columns} {table} ORDER BY id").fetchall() for table in TABLES)
        if len({name for _, name, _ in cases}) == len(cases):
            yield Path(file)
            return
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / "cases.sql"
            with closing(sqlite3.connect(copy)) as copied:
                connection.backup(copied)
                for table, names in zip(TABLES, _names_with_runs(cases, gradients)):
                    with copied:
                        copied.executemany(f"UPDATE {table} SET iteration_coordinate = ? WHERE id = ?", names)
            yield copy


def _names_with_runs(cases: list[_Row], gradients: list[_Row]) -> tuple[list[tuple[str, int]], list[tuple[str, int]]]:
    """Names of cases and of gradients that tell the runs apart, with their rows."""
    runs: list[int] = []
    seen: set[str] = set()
    for _, name, _ in cases:
        runs.append(runs[-1] + (name in seen) if runs else 0)
        seen = {name} if name in seen else seen | {name}
    times = [moment for moment, *_ in cases]
    of_gradients = []
    for moment, name, row in gradients:  # each has the name of the case that comes next, if it comes
        following = bisect(times, moment)
        is_there = following < len(cases) and cases[following][1] == name
        run = runs[following] if is_there else runs[max(following - 1, 0)]
        of_gradients.append((f"run{run}_{name}", row))
    return [(f"run{run}_{name}", row) for run, (_, name, row) in zip(runs, cases)], of_gradients
