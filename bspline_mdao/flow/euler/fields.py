"""Fields of a flow for pictures: pressures, Mach number, velocity, entropy and loss of total pressure.

On nodes and cells of all blocks and on the walls, in the formats of ParaView and Tecplot.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...grids.cells.cell_fields import face_layer
from ...grids.io.fields import quality_fields, writer_of
from ...grids.topology.block_layout import BlockLayout
from ...grids.topology.grid import Block, Grid
from ...grids.topology.node_numbering import face_rows, node_copies, source_rows
from ...grids.topology.topology import Topology
from .gas import GAMMA, mach_numbers

__all__ = ["field_values", "node_means", "wall_path", "write_flow"]


def field_values(
    states: np.ndarray,  # (n, 5), see `.gas`
    mach: float,  # mach number of the free stream
) -> dict[str, np.ndarray]:
    """Compute the fields of states."""
    # Returns by name: ``Cp``; ``Mach``; ``velocity``, shape (n, 3), relative to the speed of the free stream;
    # ``density``, relative to the free stream; ``entropy`` above the free stream, divided by the specific heat at
    # constant volume; ``total_pressure_loss``, the loss of total pressure relative to the free stream's. The last
    # two are zero in flow without shocks and without errors.
    pressure, local = GAMMA * states[:, 4], mach_numbers(states)
    total = pressure * _total(local) / _total(mach)
    return {
        "Cp": (pressure - 1.0) / (0.5 * GAMMA * mach**2),
        "Mach": local,
        "velocity": states[:, 1:4] / mach,
        "density": states[:, 0].copy(),
        "entropy": np.log(pressure) - GAMMA * np.log(states[:, 0]),
        "total_pressure_loss": 1.0 - total,
    }


def _total(mach: float | np.ndarray) -> Any:
    """Total pressure divided by pressure."""
    return (1.0 + 0.5 * (GAMMA - 1.0) * mach**2) ** (GAMMA / (GAMMA - 1.0))


def node_means(
    topology: Topology,  # how the blocks are joined
    values: np.ndarray,  # (n_cells, n), blocks in order, each in C order
) -> np.ndarray:  # (n_nodes, n)
    """Means at every node of the values of the cells around it, including cells beyond interfaces."""
    rows = source_rows(node_copies(topology), np.arange(topology.n_nodes))
    sums, counts = np.zeros((topology.n_nodes, values.shape[1])), np.zeros(topology.n_nodes)
    layout = topology.layout
    for nodes, cells in zip(layout.numbers, layout.cells.split(values)):
        for corner in np.ndindex(2, 2, 2):
            at = rows[nodes[tuple(slice(c, c + n) for c, n in zip(corner, cells.shape[:3]))].ravel()]
            counts += np.bincount(at, minlength=len(counts))
            for column, per_cell in zip(sums.T, cells.reshape(-1, values.shape[1]).T):
                column += np.bincount(at, per_cell, minlength=len(column))
    return (sums / np.maximum(counts, 1.0)[:, None])[rows]


def write_flow(
    path: str | os.PathLike,  # ``something.vtm`` for ParaView, ``something.dat`` for Tecplot
    topology: Topology,  # how the blocks are joined
    grid: Grid,  # the grid, with its patches
    states: np.ndarray,  # (n_cells, 5), states of all cells
    wall_pressures: np.ndarray,  # (n_wall,), pressure coefficients on the wall faces
    mach: float,  # mach number of the free stream
) -> None:
    """Write the fields of a flow, on nodes and cells, and in a second file on the walls, for ParaView or Tecplot."""
    # ``path`` is the file of the blocks; the file of the walls has ``_walls`` after its name, see `wall_path`. Cells
    # also have the fields of `bspline_mdao.grids.cells.cell_fields`. Faces of walls have the fields of the cells behind
    # them, but their own pressures.
    write = writer_of(path)
    on_cells, on_nodes = field_values(states, mach), field_values(node_means(topology, states), mach)
    layout = topology.layout
    fields = {name: layout.cells.split(values) for name, values in on_cells.items()} | quality_fields(grid)
    write(path, grid, {name: layout.split(values) for name, values in on_nodes.items()}, fields)
    _write_walls(wall_path(path), topology, grid, on_nodes, fields, wall_pressures)


def wall_path(path: str | os.PathLike) -> Path:
    """Path of the file of the walls next to the file of a flow.

    Examples
    --------
    >>> wall_path("flow.vtm").name
    'flow_walls.vtm'
    """
    path = Path(path)
    return path.with_name(f"{path.stem}_walls{path.suffix}")


def _write_walls(
    path: str | os.PathLike,
    topology: Topology,
    grid: Grid,
    on_nodes: Mapping[str, np.ndarray],
    fields: Mapping[str, Sequence[np.ndarray]],
    pressures: np.ndarray,
) -> None:
    """Write the faces of the walls with their pressures, in the order of the pressures: patch after patch."""
    walls = [face for face in topology.boundary if face.kind == "wall"]
    walls = [face for name in dict.fromkeys(face.patch for face in walls) for face in walls if face.patch == name]
    rows = [face_rows(topology, face.window) for face in walls]
    names = [f"{face.patch}, block {face.window.block + 1}" for face in walls]
    at_nodes = {name: [values[part] for part in rows] for name, values in on_nodes.items() if name != "Cp"}
    on_faces = {
        name: [face_layer(arrays[face.window.block], face.window, topology.shapes[face.window.block]) for face in walls]
        for name, arrays in fields.items()
    }
    on_faces["Cp"] = BlockLayout.of(part.shape for part in rows).cells.split(pressures)
    at_nodes["Cp"] = _at_corners(topology, rows, on_faces["Cp"])
    nodes = grid.to_vector().reshape(-1, 3)
    surface = Grid(tuple(Block(nodes[part], name) for part, name in zip(rows, names)), source=str(path))
    writer_of(path)(path, surface, at_nodes, on_faces)


def _at_corners(topology: Topology, rows: list[np.ndarray], on_faces: list[np.ndarray]) -> list[np.ndarray]:
    """Means at the nodes of walls of the pressures on the faces around them."""
    copies = node_copies(topology)
    sums, counts = np.zeros(topology.n_nodes), np.zeros(topology.n_nodes)
    for part, values in zip(rows, on_faces):
        for corner in np.ndindex(*(min(n, 2) for n in part.shape)):
            sizes = zip(corner, values.shape)
            at = source_rows(copies, part[tuple(slice(c, c + n) for c, n in sizes)].ravel())
            np.add.at(sums, at, values.ravel())
            np.add.at(counts, at, 1.0)
    means = sums / np.maximum(counts, 1.0)
    return [means[source_rows(copies, part.ravel())].reshape(part.shape) for part in rows]
