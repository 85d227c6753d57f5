r"""A file of many designs: one HDF5 file whose arrays are laid out when it is made and then filled row by row.

::

    /                       attributes: format, version, package, plan, model (checksum), n_designs, stored
    variables/NAME          (n, size): values of a design variable; attributes names, units, lower, upper
    state                   (n,): 0 not made yet, 1 made, 2 refused
    reason                  (n,): why a design was refused
    quality/NAME            (n,): smallest Q, smallest corner, inverted cells, ... of a design that was made
    outputs/NAME            (n, size): measures and other outputs of the problem; attribute units
    nodes                   (n, n_nodes, 3): nodes of the grid (m), where they are stored
    control_points          (n, n_control_points, 3): control points (m), where they are stored

All arrays are contiguous, so a row is one piece of the file. Processes write their rows without the HDF5 library, only
these pieces ever change, and a killed run leaves an intact file. A row counts once its state says so, and the state is
written last.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ....base.display import OneLine
from ....base.text import counted
from ....errors import InputError

__all__ = ["MADE", "NODES", "PENDING", "REFUSED", "Column", "Designs", "Rows", "make_designs", "opened"]

FORMAT, VERSION = "bspline_mdao designs", 1

PENDING, MADE, REFUSED = range(3)
"""States of a design."""

NODES = "nodes"

_LONGEST_REASON = 400
"""Number of bytes of a reason that are stored."""


@dataclass(frozen=True)
class Column:
    """An array of the file, as it is for one design."""

    name: str
    shape: tuple[int, ...] = ()
    dtype: Any = float
    units: str = ""


def make_designs(
    file: str | os.PathLike,  # file to make
    variables: Mapping[str, Mapping[str, Any]],  # size, units, lower and upper of each
    values: Mapping[str, np.ndarray],  # (n, size), of each
    columns: Sequence[Column],  # what else is stored for every design
    about: Mapping[str, Any],  # attributes
) -> None:
    """Lay out the file; `InputError` if it exists, or if the disk has no room for it."""
    path, n = Path(file), len(next(iter(values.values())))
    all_columns = [*columns, Column("state", dtype=np.int8), Column("reason", dtype=f"S{_LONGEST_REASON}")]
    n_bytes = n * sum(int(np.prod(c.shape)) * np.dtype(c.dtype).itemsize for c in all_columns)
    path.parent.mkdir(parents=True, exist_ok=True)
    room = shutil.disk_usage(path.parent).free
    if n_bytes > room:
        raise InputError(
            f"{path}: {counted(n, 'design')} take {n_bytes / 1e9:.3g} GB, and the disk has {room / 1e9:.3g} GB left; "
            f"store control points instead of nodes, take single precision, or fewer designs"
        )
    try:
        with h5py.File(path, "x") as made:
            made.attrs.update({"format": FORMAT, "version": VERSION, "n_designs": n, **about})
            for folder in ("variables", *dict.fromkeys(c.name.split("/")[0] for c in columns if "/" in c.name)):
                made.create_group(folder, track_order=True)
            for name, meta in variables.items():
                made[f"variables/{name}"] = values[name]
                attributes = {key: meta[key] for key in ("lower", "upper")}
                attributes |= {"units": meta["units"] or "", "names": list(meta["names"])}
                made[f"variables/{name}"].attrs.update(attributes)
            for column in all_columns:
                _lay_out(made, column, n)
    except FileExistsError:
        raise InputError(f"{path}: is there; continue it with restart=True, or name another file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error})") from None


def _lay_out(made: h5py.File, column: Column, n: int) -> None:
    """Reserve space for an array without writing it: the file system gives zeros."""
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_layout(h5py.h5d.CONTIGUOUS)
    properties.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    properties.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    kind = h5py.h5t.py_create(np.dtype(column.dtype), logical=True)
    space = h5py.h5s.create_simple((n, *column.shape))
    h5py.h5d.create(made.id, column.name.encode(), kind, space, dcpl=properties)
    if column.units:
        made[column.name].attrs["units"] = column.units


class Rows:
    """Rows of a file of designs, written by one of several processes."""

    def __init__(self, file: str | os.PathLike):
        self._arrays = {}
        with opened(file) as found:
            for name, data in _datasets(found):
                if not name.startswith("variables/"):
                    self._arrays[name] = np.memmap(
                        file, data.dtype, mode="r+", offset=data.id.get_offset(), shape=data.shape
                    )

    @property
    def states(self) -> np.ndarray:
        """States of all designs as they are now, shape (n,)."""
        return self._arrays["state"]

    def write(self, row: int, values: Mapping[str, Any]) -> None:
        """Write the stored data of a design that was made."""
        for name, value in values.items():
            self._arrays[name][row] = value
        self._finish(row, MADE)

    def refuse(self, row: int, reason: str) -> None:
        """Store why there is no design; its numbers stay NaN."""
        for array in self._arrays.values():
            if array.dtype.kind == "f":
                array[row] = np.nan
        self._arrays["reason"][row] = reason.encode()[:_LONGEST_REASON]
        self._finish(row, REFUSED)

    def _finish(self, row: int, state: int) -> None:
        self._arrays["state"][row] = state


@dataclass(frozen=True, eq=False)
class Designs(OneLine):
    """The valid designs of a file, in order: a sequence that PyTorch accepts as a ``Dataset``.

    ``designs[i]`` is a pair: the values of all variables of a design, shape (n_values,), and its stored data, the grid
    nodes, shape (n_nodes, 3), or the control points. The file is opened for each design, so several processes may read
    it at once, even while it is being written; designs made by then count.

    Parameters
    ----------
    file : path-like
        File written by `sample`.

    Raises
    ------
    InputError
        If it is not such a file.

    Examples
    --------
    >>> from bspline_mdao.sampling import Designs
    >>> designs = Designs("designs.h5")  # doctest: +SKIP
    >>> values, nodes = designs[0]  # doctest: +SKIP
    """

    file: Path

    def __init__(self, file: str | os.PathLike):
        object.__setattr__(self, "file", Path(file))
        with opened(file) as found:
            rows = np.flatnonzero(found["state"][:] == MADE)
            about = {name: _plain(value) for name, value in found.attrs.items()}
        object.__setattr__(self, "rows", rows)
        object.__setattr__(self, "about", about)

    rows: np.ndarray  # (n,), positions of the designs among all requested ones
    about: Mapping[str, Any]  # the file's own attributes: plan, model, package

    def __len__(self) -> int:
        """Number of designs that were made."""
        return len(self.rows)

    def __getitem__(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Values of the variables of a design, and its stored data."""
        row = self.rows[number]
        with opened(self.file) as found:
            values = np.concatenate([found["variables"][name][row] for name in found["variables"]])
            stored = self.about["stored"]
            return values, found[stored][row] if stored else np.zeros((0, 3))

    @property
    def ranges(self) -> dict[str, tuple[float, float, str]]:
        """Lower and upper bounds and units of every value of a design by name, such as ``twist[1]``."""
        with opened(self.file) as found:
            return {
                name: (float(low), float(high), variable.attrs["units"])
                for variable in found["variables"].values()
                for name, low, high in zip(*(variable.attrs[key] for key in ("names", "lower", "upper")))
            }

    @property
    def values(self) -> np.ndarray:
        """Values of the variables of all designs, shape (n, n_values), in the order of `ranges`."""
        with opened(self.file) as found:
            return np.concatenate([found["variables"][name][:][self.rows] for name in found["variables"]], axis=1)

    @property
    def quality(self) -> dict[str, np.ndarray]:
        """Quality numbers of all designs, each of shape (n,)."""
        with opened(self.file) as found:
            return {name: found["quality"][name][:][self.rows] for name in found.get("quality", ())}

    @property
    def outputs(self) -> dict[str, np.ndarray]:
        """Outputs of the problem at all designs, each of shape (n, size)."""
        with opened(self.file) as found:
            return {name: found["outputs"][name][:][self.rows] for name in found.get("outputs", ())}

    @property
    def refused(self) -> dict[int, str]:
        """Why designs were refused, by their positions among all requested ones."""
        with opened(self.file) as found:
            rows = np.flatnonzero(found["state"][:] == REFUSED)
            return {int(row): found["reason"][row].decode(errors="replace") for row in rows}

    def grid(self, number: int, model: Any) -> Any:
        """Return the grid or mesh of a design, for example to write it by `bspline_mdao.write_grid`.

        Parameters
        ----------
        number : int
            Number of the design among those made, from 0.
        model : FittedModel or MeshModel
            The model that was sampled.

        Returns
        -------
        Grid or MixedMesh

        Raises
        ------
        InputError
            If the model is a different one, or nothing is stored.
        """
        if model.checksum != self.about["model"]:
            raise InputError(f"{self.file}: holds designs of another model than {model.source}; give that one")
        stored = self.about["stored"]
        if not stored:
            raise InputError(f"{self.file}: holds numbers of designs alone; sample with store='nodes' for their grids")
        points = np.asarray(self[number][1], dtype=float)
        return model.with_nodes(points if stored == NODES else model.node_map.at(points).nodes)


@contextmanager
def opened(file: str | os.PathLike) -> Iterator[h5py.File]:
    """Open a file of designs for reading; `InputError` if it is not one."""
    try:
        found = h5py.File(file, "r", locking=False)
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read as a file of designs ({error})") from None
    with found:
        if found.attrs.get("format") != FORMAT:
            raise InputError(f"{file}: is no file of designs; the command sample writes them")
        if found.attrs["version"] > VERSION:
            raise InputError(f"{file}: is of version {found.attrs['version']}, newer than {VERSION}, the newest here")
        yield found


def _datasets(found: h5py.File) -> list[tuple[str, h5py.Dataset]]:
    """All arrays of a file by their paths."""
    names: list[str] = []
    found.visit(names.append)
    return [(name, found[name]) for name in names if isinstance(found[name], h5py.Dataset)]


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
