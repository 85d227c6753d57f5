"""Rows of case files: how many there are, and how those of one run come before those of the next.

OpenMDAO reads these files, and writes new ones; it has no call for either.
"""

from __future__ import annotations

import os
import sqlite3
import time
from contextlib import closing

from ...errors import InputError

__all__ = ["count_cases", "take_over"]

TABLES = ("driver_iterations", "driver_derivatives")
"""Tables of what a driver has recorded."""


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
