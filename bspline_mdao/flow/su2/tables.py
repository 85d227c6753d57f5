"""Tables written by SU2: ``history.csv``, ``surface_flow.csv`` and the restart of its adjoint.

All are CSV with quoted names on the first line. Versions 7 and 8 name coefficients ``CD``, ``CL``, ``CMz``, ``CFx`` in
the history, where 8.2 pads them with blanks, and nodes by ``PointID``, counted from 0 as in the mesh; version 7.0 and
older use ``Global_Index`` or ``Point``. On several processes nodes come in any order.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.display import OneLine
from ...errors import SolverError

__all__ = ["NodeTable", "last_of_history"]

NUMBERS = ("PointID", "Global_Index", "Point")
"""Names of the column of the nodes' numbers."""


def last_of_history(path: Path) -> dict[str, float]:
    """Values of the last iteration by name."""
    names, rows = _read(path)
    values = dict(zip(names, rows[-1]))
    wrong = next((name for name, value in values.items() if not np.isfinite(value)), None)
    if wrong is not None:
        raise SolverError(f"{path}: {wrong} is {values[wrong]}; the flow diverged; take a smaller step")
    return values


@dataclass(frozen=True, eq=False)
class NodeTable(OneLine):
    """Values at nodes."""

    path: Path
    names: list[str]
    nodes: np.ndarray  # (n,) of int, ascending
    values: np.ndarray  # (n, n_names)

    @classmethod
    def read(cls, path: Path) -> NodeTable:
        """Read a table, whose nodes may be in any order."""
        names, rows = _read(path)
        at = next((names.index(name) for name in NUMBERS if name in names), None)
        if at is None:
            raise SolverError(f"{path}: has no column {NUMBERS[0]}; write it with SU2 7 or 8")
        nodes, first = np.unique(rows[:, at].astype(int), return_index=True)
        return cls(path, names, nodes, rows[first])

    def column(self, name: str) -> np.ndarray:
        """Values of one name."""
        if name not in self.names:
            raise SolverError(f"{self.path}: has no column {name}, only {', '.join(self.names)}; check VOLUME_OUTPUT")
        return self.values[:, self.names.index(name)]

    def vectors(self, name: str, n_axes: int, n_nodes: int) -> np.ndarray:
        """Vectors such as ``Sensitivity_x`` and so on at all nodes of a mesh, shape (n_nodes, n_axes)."""
        if not np.array_equal(self.nodes, np.arange(n_nodes)):
            raise SolverError(f"{self.path}: has {len(self.nodes):,} nodes, the mesh {n_nodes:,}; it is of another run")
        found = np.stack([self.column(f"{name}_{axis}") for axis in "xyz"[:n_axes]], axis=1)
        if not np.isfinite(found).all():
            raise SolverError(f"{self.path}: {name} is not finite; the adjoint diverged; converge the flow further")
        return found


def _read(path: Path) -> tuple[list[str], np.ndarray]:
    """Names of the columns, and the rows."""
    try:
        with open(path, newline="", encoding="utf-8", errors="replace") as file:
            lines = [row for row in csv.reader(file, skipinitialspace=True) if row]
    except OSError as error:
        raise SolverError(f"{path}: was not written ({error.strerror}); check the log next to it") from error
    names = [name.strip().strip('"').strip() for name in lines[0]] if lines else []
    try:
        rows = np.array([[float(value) for value in row[: len(names)]] for row in lines[1:]])
    except ValueError as error:
        raise SolverError(f"{path}: is damaged ({error}); check the log next to it") from error
    if rows.ndim != 2 or rows.shape[1] != len(names):
        raise SolverError(f"{path}: has no whole rows; check the log next to it")
    return names, rows
