"""What can be plotted at one moment: a grid, its control mesh, and a flow about it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import openmdao.api as om

from ...base.display import OneLine
from ...base.numerics.processes import from_all
from ...core.model.movable import Movable
from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.topology.grid import Grid
from ...grids.topology.partition import Partition, Subdomain
from ...names import CONTROL_POINTS, GRID
from .snapshot_files import FlowFields, suffix_of, write_files

__all__ = ["Snapshot"]


@dataclass(frozen=True, eq=False)
class Snapshot(OneLine):
    """A copy of a grid and its fields, kept while a problem continues.

    Parameters
    ----------
    grid : Grid or MixedMesh
        The grid, or the unstructured mesh.
    title : str
        Its name in pictures.
    model : FittedModel, LocalModel, MeshModel or None
        The model that it belongs to.
    control_points : ndarray or None
        Its control points (m), shape (n_control_points, 3).
    pressures : ndarray or None
        Pressure coefficients of the wall faces, for an `EulerFlow`.
    states : ndarray or None
        Its states.
    mach : float or None
        Mach number of the free stream.
    lattice, panel_pressures : ndarray or None
        Nodes of the lattice of a `LatticeFlow` in the axes of the grid (m), shape (n_chord, n_span, 3), and its output
        ``delta_Cp``, shape (n_chord - 1, n_span - 1).

    Examples
    --------
    >>> from bspline_mdao.flow import Snapshot
    >>> from bspline_mdao.generators import brick_grid
    >>> Snapshot.of(brick_grid((5, 5, 5, 5)), title="baseline")
    Snapshot('baseline', 750 nodes, no flow)
    """

    grid: Any
    title: str
    model: Movable | None = None
    control_points: np.ndarray | None = None
    pressures: np.ndarray | None = None
    states: np.ndarray | None = None
    mach: float | None = None
    lattice: np.ndarray | None = None
    panel_pressures: np.ndarray | None = None

    def __repr__(self) -> str:
        flow = "no flow" if self.pressures is None else f"Mach {self.mach:.3g}"
        n_nodes = self.model.n_nodes if self.model is not None else self.grid.to_vector().size // 3
        return f"Snapshot({self.title!r}, {n_nodes:,} nodes, {flow})"

    @classmethod
    def of(cls, what: Any, title: str | None = None) -> Snapshot:
        """Take a grid, a fitted grid, or the current state of a problem.

        Parameters
        ----------
        what : Grid, MixedMesh, FittedModel, MeshModel, openmdao.api.Problem, openmdao.api.Group or Snapshot
            In a problem or one of its groups, the first `GridMovement`, `GridEvaluate` or flow provides the grid, and
            the first `EulerFlow` or `LatticeFlow` the flow.
        title : str, optional
            Its name in pictures.

        Returns
        -------
        Snapshot
            A copy: it does not change with the problem.

        Raises
        ------
        InputError
            If there is no grid in it, or a problem has not been run.
        """
        if isinstance(what, cls):
            return what
        if isinstance(what, Grid | MixedMesh):
            return cls(what, title or what.source)
        if isinstance(what, Movable):
            return cls(what.baseline, title or what.source, what, what.control_points)
        if hasattr(what, "model") and hasattr(what.model, "system_iter"):
            return _of_group(what.model, title or "now")
        if hasattr(what, "system_iter"):
            return _of_group(what, title or "now")
        raise InputError(
            f"nothing to look at in a {type(what).__name__}; give a Grid, a FittedModel, a MeshModel, or a problem "
            f"that has run"
        )

    def write(self, path: str | os.PathLike) -> dict[str, Path]:
        """Write what is available, for ParaView or Tecplot.

        Parameters
        ----------
        path : path-like
            ``something.vtm`` or ``something.dat``: the grid, with the quality and the place of its cells, and the flow,
            see `EulerFlow.write_fields`. Walls go to ``something_walls``, the control mesh to ``something_control``.
            For an unstructured mesh ``something.vtu``: its cells, with their quality and with the displacements of
            nodes; in two dimensions the cells of its plane. Walls go to ``something_walls.vtu``, the lattice to
            ``something_control.vtm``.

        Returns
        -------
        dict of str to Path
            ``grid``, and if available ``walls`` and ``control mesh``: the files.

        Raises
        ------
        InputError
            If the suffix is different, or a file cannot be written.
        """
        flow = None
        if self.states is not None and self.pressures is not None and self.mach is not None:
            flow = FlowFields(self.states, self.pressures, self.mach)
        return write_files(self.grid, Path(path), self.model, self.control_points, flow)

    @property
    def suffix(self) -> str:
        """Suffix of a file of the grid for ParaView."""
        return suffix_of(self.grid)


def _of_group(group: om.Group, title: str) -> Snapshot:
    """Current contents of a group of a problem, gathered from all processes."""
    systems = list(group.system_iter(include_self=True, recurse=True))
    model = next((found for system in systems if (found := _model_of(system)) is not None), None)
    if model is None:
        raise InputError("the problem has no GridMovement, GridEvaluate or EulerFlow of a model to look at")
    values = _values(systems)
    if GRID not in values and group.comm.size == 1:  # the grid of a LatticeFlow is the input of no component
        with suppress(KeyError):
            values[GRID] = np.array(group.get_val(GRID))
    if GRID not in values:
        raise InputError("the problem has no grid yet; run it first: problem.run_model()")
    grid = model.with_nodes(values[GRID].reshape(-1, 3))
    points, mach = values.get(CONTROL_POINTS), values.get("Mach_number")
    return Snapshot(
        grid,
        title,
        model,
        model.control_points if points is None else points.reshape(-1, 3),
        values.get("Cp"),
        values.get("states"),
        None if mach is None else float(mach.ravel()[0]),
        *_lattice(systems),
    )


def _lattice(systems: Iterable[om.System]) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Nodes of the first lattice in the axes of the grid, and the pressure differences on it."""
    for system in systems:
        if "camber" in system.options and "delta_Cp" in system.get_io_metadata(metadata_keys=()):
            nodes = system.get_val("camber_surface", from_src=False) @ system.options["camber"].axes
            return nodes, np.array(system.get_val("delta_Cp"))
    return None, None


def _model_of(system: om.System) -> Movable | None:
    """The model with which a system was made."""
    found = system.options["model"] if "model" in system.options else None  # noqa: SIM401 (no mapping: it has no get)
    return found if isinstance(found, Movable) else None


def _values(systems: Iterable[om.System]) -> dict[str, np.ndarray]:
    """Copies of the values of the requested variables, from the first component that has each."""
    found: dict[str, np.ndarray] = {}
    for system in systems:
        local = system.get_io_metadata(metadata_keys=())
        for name in (GRID, CONTROL_POINTS, "Cp", "states", "Mach_number"):
            if name not in found and name in local:
                value = np.array(system.get_val(name, from_src=False))
                found[name] = value if system.comm.size == 1 else _gathered(systems, system, name, value)
    return found


def _gathered(systems: Iterable[om.System], system: om.System, name: str, value: np.ndarray) -> np.ndarray:
    """The whole of a distributed variable: nodes by their rows, states by their cells."""
    if name not in (GRID, "states"):
        return value
    subdomain = _subdomain(systems, system.comm)
    numbers = subdomain.rows if name == GRID else subdomain.cells
    every = from_all(system.comm, (numbers, value.reshape(len(numbers), -1)))
    whole = np.empty((1 + max(int(local.max(initial=-1)) for local, _ in every), every[0][1].shape[1]))
    for local, part in every:
        whole[local] = part
    return whole.ravel()


def _subdomain(systems: Iterable[om.System], comm: Any) -> Subdomain:
    """Nodes and cells of this process, from the components that have parts of the grid."""
    for system in systems:
        given = "partition" in system.options and system.options["partition"]
        if isinstance(given, Subdomain):
            return given
        if isinstance(given, Partition):
            return given.subdomain(comm.rank)
        if (model := _model_of(system)) is not None and model.ownership is not None:
            return model.ownership
    model = next(model for system in systems if (model := _model_of(system)) is not None)
    return model.partition(comm.size).subdomain(comm.rank)
