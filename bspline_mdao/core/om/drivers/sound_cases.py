"""Harmless copies of case files, in which OpenMDAO's reader finds the same cases but no code to run.

OpenMDAO unpacks pickles while it opens a file, and looks for more in its arrays; a pickle calls what it names. Here
nothing is called. System options are read from their pickles with every name mapped to one class that does nothing,
arrays contain only numbers, and compressed data may grow only within limits.

Theory: ``docs/theory/drivers.rst``, "How a run ends".
"""

from __future__ import annotations

import io
import json
import os
import pickle
import pickletools
import sqlite3
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ....errors import InputError
from ....grids.io.disk import MAX_RATIO, MAX_SMALL
from .case_file import COLUMNS, Moment, columns_of, names_with_runs, opened_cases

__all__ = ["SoundCases", "sound_cases"]

OLDEST = 14
"""Format version of OpenMDAO 3.8, the first with compressed metadata."""

_EMPTY = {
    "global_iterations": ("id", "record_type", "rowid", "source"),
    "problem_cases": ("id", "counter", "case_name"),
    "system_iterations": ("id", "counter", "iteration_coordinate"),
    "solver_iterations": ("id", "counter", "iteration_coordinate"),
    "system_metadata": ("id", "scaling_factors", "component_metadata"),
    "solver_metadata": ("id", "solver_options", "solver_class"),
}
"""Tables that OpenMDAO's reader needs, unrelated to driver cases."""

_METADATA = ("abs2prom", "prom2abs", "abs2meta", "var_settings", "conns")


class SoundCases(NamedTuple):
    """Cases of a driver and related data."""

    file: Path  # A case file for OpenMDAO's reader, with only the driver's cases
    # recorded options of the model's systems in the last run, by system name
    options: Mapping[str, Mapping[str, object]]


@contextmanager
def sound_cases(
    # case file of ``om.SqliteRecorder``; if it is one of several processes' files, their common data is in ``..._meta``
    file: str | os.PathLike,
) -> Iterator[SoundCases]:
    """Copy the cases of a driver into a file that exists until the block ends."""
    with tempfile.TemporaryDirectory() as folder, opened_cases(file) as source:
        copy = Path(folder) / "cases.sql"
        with closing(sqlite3.connect(copy)) as target, target:
            target.execute("PRAGMA synchronous = OFF")  # it is deleted when the block ends
            for table, columns in _EMPTY.items():
                target.execute(f"CREATE TABLE {table} ({', '.join(columns)})")
            for table, names in zip(COLUMNS, _names(source)):
                _copy_cases(source, target, table, names)
            if columns_of(source, "metadata"):
                options = _copy_metadata(file, source, target)
            else:
                with opened_cases(_shared_by_processes(file)) as shared:
                    options = _copy_metadata(file, shared, target)
        yield SoundCases(copy, options)


def _shared_by_processes(file: str | os.PathLike) -> str:
    """File with the common data of processes that each write a numbered file."""
    stem, _, number = os.fspath(file).rpartition("_")
    if not stem or not number.isdecimal():
        raise InputError(f"{file}: is no case file that can be read (it has no table metadata); it may be damaged")
    return f"{stem}_meta"


def _moments(source: sqlite3.Connection, table: str) -> list[Moment]:
    """Time and name of every row of a table of cases."""
    if missing := sorted(set(COLUMNS[table]) - columns_of(source, table)):
        raise ValueError(f"the table {table} has no {missing[0]}")
    rows = source.execute(f"SELECT timestamp, iteration_coordinate, id FROM {table} ORDER BY id").fetchall()
    for moment, name, number in rows:
        if not isinstance(name, str) or not isinstance(moment, float):
            raise ValueError(f"row {number} of {table} has no name or no time")
    return [(moment, name) for moment, name, _ in rows]


def _names(source: sqlite3.Connection) -> tuple[list[str], list[str]]:
    """Names by which OpenMDAO identifies the cases and their gradients: the file's own if they are distinct."""
    cases, gradients = (_moments(source, table) for table in COLUMNS)
    if len({name for _, name in cases}) < len(cases):
        return names_with_runs(cases, gradients)
    return [name for _, name in cases], [name for _, name in gradients]


def _copy_cases(source: sqlite3.Connection, target: sqlite3.Connection, table: str, names: list[str]) -> None:
    """Copy the cases of a table under other names."""
    columns = COLUMNS[table]
    listed, place = ", ".join(columns), columns.index("iteration_coordinate")
    target.execute(f"CREATE TABLE {table} ({listed})")
    target.execute(f"CREATE INDEX of_{table} ON {table}(iteration_coordinate)")
    for name, row in zip(names, source.execute(f"SELECT {listed} FROM {table} ORDER BY id")):
        if (stored := dict(zip(columns, row)).get("derivatives")) is not None:
            _check_array(stored)
        values = (*row[:place], name, *row[place + 1 :])
        target.execute(f"INSERT INTO {table} VALUES ({', '.join('?' * len(columns))})", values)


def _check_array(stored: bytes) -> None:
    """Refuse an array of objects, which are pickles, or anything that is not an array."""
    np.lib.format.read_array(io.BytesIO(stored), allow_pickle=False, max_header_size=len(stored))


def _copy_metadata(
    file: str | os.PathLike, source: sqlite3.Connection, target: sqlite3.Connection
) -> dict[str, dict[str, object]]:
    """Copy the metadata of variables and of the model's diagram; return the options of its systems."""
    names = ("format_version", "openmdao_version", *_METADATA)
    target.execute(f"CREATE TABLE metadata ({', '.join(names)})")
    version, release, *texts = source.execute(f"SELECT {', '.join(names)} FROM metadata").fetchone()
    if not isinstance(version, int) or version < OLDEST:
        raise InputError(f"{file}: was recorded by OpenMDAO before 3.8, or is damaged; record it again")
    found = dict(zip(_METADATA, map(_unpacked, texts)))
    if not all(isinstance(name, str) for names in found["abs2prom"].values() for name in names.values()):
        raise ValueError("a name of a variable is no text")
    for meta in found["abs2meta"].values():  # bounds would be spread to arrays of any size
        meta["lower"] = meta["upper"] = None
    packed = [zlib.compress(json.dumps(found[name]).encode()) for name in _METADATA]
    target.execute(f"INSERT INTO metadata VALUES ({', '.join('?' * len(names))})", (version, release, *packed))
    target.execute("CREATE TABLE driver_metadata (id, model_viewer_data)")
    rows = source.execute("SELECT id, model_viewer_data FROM driver_metadata")
    target.executemany("INSERT INTO driver_metadata VALUES (?, ?)", rows)
    return _options_of_last_run(source)


def _options_of_last_run(source: sqlite3.Connection) -> dict[str, dict[str, object]]:
    """Options of all systems; every recorded ``run_model`` and ``run_driver`` is a numbered run."""
    rows = source.execute("SELECT id, component_metadata FROM system_metadata ORDER BY rowid").fetchall()
    parts = [key.partition("!") for key, _ in rows]
    runs = [int(number or 0) for _, _, number in parts]
    last = max(runs, default=0)
    found = zip(parts, runs, rows)
    return {name: _options(_decompressed(stored)) for (name, *_), run, (_, stored) in found if run == last}


def _unpacked(stored: bytes) -> dict:
    """Mapping of compressed JSON."""
    found = json.loads(_decompressed(stored))
    if not isinstance(found, dict):
        raise ValueError("its metadata are no mappings")
    return found


def _decompressed(stored: bytes) -> bytes:
    """Decompressed data, if its size stays within limits."""
    member, limit = zlib.decompressobj(), max(MAX_SMALL, MAX_RATIO * len(stored))
    try:
        found = member.decompress(stored, limit)
    except zlib.error as error:
        raise ValueError(str(error)) from None
    if not member.eof:
        raise ValueError(f"metadata end in the middle, or grow from {len(stored)} to more than {limit} bytes")
    return found


class _Inert:
    """Stand-in for everything a pickle names: accepts any arguments and does nothing."""

    def __init__(self, *arguments: Any, **settings: Any):
        self.state: Any = None

    def __setstate__(self, state: Any) -> None:
        self.state = state

    def _ignore(self, *what: Any) -> None:
        """Accept members of a would-be list, set or mapping."""

    append = extend = add = __setitem__ = _ignore


class _InertText(_Inert):
    """Text of an object in case files: see `bspline_mdao.core.om.model_option`."""

    def __init__(self, *arguments: Any, **settings: Any):
        super().__init__()
        self.text = arguments[0] if arguments and isinstance(arguments[0], str) else ""


class _Unpickler(pickle.Unpickler):
    """Pickle reader that calls nothing."""

    def find_class(self, module: str, name: str) -> type:
        """Return the same class for every name."""
        return _InertText if (module, name) == ("builtins", "str") else _Inert


def _options(stored: bytes) -> dict[str, object]:
    """Values of the options of a system: texts, numbers, and lists and mappings of them."""
    for opcode, place, _ in pickletools.genops(stored):  # also detects lengths beyond the end
        if opcode.name in ("PUT", "LONG_BINPUT") and int(place or 0) > len(stored):
            raise ValueError("options of a system are damaged")
    try:
        found = _Unpickler(io.BytesIO(stored)).load()
    except pickle.UnpicklingError as error:
        raise ValueError(str(error)) from None
    state = found.state if isinstance(found, _Inert) else None
    declared = state.get("_dict") if isinstance(state, dict) else None
    if not isinstance(declared, dict):
        raise ValueError("options of a system are damaged")
    values = {name: meta.get("val") for name, meta in declared.items() if isinstance(meta, dict)}
    texts = {name: value.text for name, value in values.items() if isinstance(value, _InertText)}
    return {name: value for name, value in values.items() if not isinstance(value, _Inert)} | texts
