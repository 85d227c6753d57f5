"""Files of snapshots: of a grid of blocks with its flow, and of an unstructured mesh, each with its control mesh.

The kind of the grid determines which are written.
"""

from __future__ import annotations

from functools import singledispatch
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...core.background.mesh_model import MeshModel
from ...core.model.model import Model
from ...core.model.movable import Movable
from ...errors import InputError
from ...grids.cells.mesh_fields import pyramid_ratios, wall_heights
from ...grids.cells.mesh_quality import mesh_quality
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.cells.mixed_quality import MixedQuality
from ...grids.io.fields import write_with_quality, writer_of
from ...grids.io.meshes.vtu_output import write_vtu, write_vtu_faces
from ...grids.io.vtk import write_vtk
from ...grids.topology.grid import Block, Grid
from ..euler.fields import wall_path, write_flow
from ..euler.gas import N_STATES

__all__ = ["FlowFields", "suffix_of", "write_files"]


class FlowFields(NamedTuple):
    """A flow about a grid of blocks."""

    states: np.ndarray  # its states, cell after cell
    pressures: np.ndarray  # pressure coefficients of the wall faces
    mach: float  # Mach number of the free stream


def suffix_of(grid: Grid | MixedMesh) -> str:
    """Suffix of the file of a grid for ParaView."""
    return ".vtu" if isinstance(grid, MixedMesh) else ".vtm"


@singledispatch
def write_files(
    grid: Any,  # Grid or MixedMesh
    path: Path,  # file for it
    model: Movable | None,  # the model that it belongs to
    control_points: np.ndarray | None,  # its control points (m), shape (n_control_points, 3)
    flow: FlowFields | None,  # the flow about it
) -> dict[str, Path]:
    """Write what is available for a grid; return the files by content."""
    raise InputError(f"{path}: nothing is known of a {type(grid).__name__}; give a Grid or a MixedMesh")


@write_files.register(Grid)
def _of_blocks(
    grid: Grid, path: Path, model: Movable | None, control_points: np.ndarray | None, flow: FlowFields | None
) -> dict[str, Path]:
    written, write = {"grid": path}, writer_of(path)
    if isinstance(model, Model) and flow is not None:
        write_flow(path, model.topology, grid, flow.states.reshape(-1, N_STATES), flow.pressures, flow.mach)
        written["walls"] = wall_path(path)
    else:
        write_with_quality(path, grid)
    if isinstance(model, Model) and control_points is not None:
        nets = model.mesh.nets(control_points)
        blocks = tuple(Block(net, name) for net, name in zip(nets, model.topology.segment_names))
        written["control mesh"] = path.with_name(f"{path.stem}_control{path.suffix}")
        write(written["control mesh"], Grid(blocks, source="control mesh"))
    return written


@write_files.register(MixedMesh)
def _of_mesh(
    grid: MixedMesh, path: Path, model: Movable | None, control_points: np.ndarray | None, flow: FlowFields | None
) -> dict[str, Path]:
    if path.suffix.lower() != ".vtu":
        raise InputError(f"{path}: an unstructured mesh goes to a .vtu file; name it {path.stem}.vtu")
    on_cells = {"non_orthogonality": mesh_quality(grid).cell_angles}
    if not isinstance(model, MeshModel):
        write_vtu(path, grid, None, on_cells)
        return {"grid": path}
    nodes, before, walls = grid.points, model.mesh, model.walls
    quality = MixedQuality.of(before, walls.faces)
    on_nodes = {"displacement": nodes - before.points, "wall_height": wall_heights(quality, nodes)}
    write_vtu(path, grid, on_nodes, on_cells | {"pyramid": pyramid_ratios(quality, nodes)})
    written = {"grid": path, "walls": path.with_name(f"{path.stem}_walls.vtu")}
    write_vtu_faces(written["walls"], nodes, walls.faces, on_nodes, {"marker": walls.marker + 1})
    if control_points is not None:
        net = model.splines_at(control_points)[1].reshape(*model.lattice.shape, 3)
        written["control mesh"] = path.with_name(f"{path.stem}_control.vtm")
        write_vtk(written["control mesh"], Grid((Block(np.ascontiguousarray(net), "lattice"),), source="lattice"))
    return written
