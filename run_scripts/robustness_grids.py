"""Grids that are made ready for drastic changes of shape: canonical ones and those of a folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from morphs import BLENDED_WING_BODY, ONERA_M6

from bspline_mdao import FittedModel, Grid, InputError, Shape, find_topology, fit_grid, fit_shape, read_grid
from bspline_mdao.cells.grid_quality import GridQuality
from bspline_mdao.design.named_deformations import parse_deformation
from bspline_mdao.io.patch_guess import guess_patches
from bspline_mdao.mesh.boundary import moving_mesh
from bspline_mdao.mesh.moving_mesh import MovingMesh

MORPHS = {"plate": BLENDED_WING_BODY, "M6": ONERA_M6}
"""The canonical grids, each with the shape that section IV gives it."""

SIZES = {True: ((23, 33, 17), (9, 9, 7)), False: ((11, 13, 9), (7, 8, 5))}
"""Nodes and control points of each of their twelve blocks, by ``paper``."""

LARGEST = {True: 200_000, False: 20_000}
"""Nodes of the largest real grid, by ``paper``."""


def collect(paper: bool, folder) -> tuple[list[Body], dict[str, str]]:
    """Prepare the canonical grids and those of a folder.

    Returns
    -------
    bodies : list of Body
    left_out : dict of str
        Why a file is left out, by its name.
    """
    shape, n_control = SIZES[paper]
    bodies = [Body.of(name, case.make_grid(shape), n_control, case.make_shape()) for name, case in MORPHS.items()]
    left_out, seen = {}, set()
    for path in sorted(Path(folder).iterdir()) if folder else ():
        try:
            grid = read_grid(path)
            refuse(grid, seen, LARGEST[paper])
            seen.add(grid.shapes)
            bodies.append(Body.of(path.name, grid))
        except InputError as error:
            left_out[path.name] = str(error).replace(f"{path}: ", "")
    return bodies, left_out


def refuse(grid: Grid, seen: set, largest: int) -> None:
    """Leave out what is too large, and what is a grid of before in another dialect."""
    if grid.n_nodes > largest:
        raise InputError(f"{grid.n_nodes} nodes")
    if grid.shapes in seen:
        raise InputError("another grid has the same blocks")


def with_patches(grid: Grid) -> Grid:
    """Guess what the boundary is where nobody declared it."""
    undeclared = [face.window for face in find_topology(grid).boundary if face.patch is None]
    return replace(grid, patches=(*grid.patches, *guess_patches(grid, undeclared))) if undeclared else grid


@dataclass(frozen=True, eq=False)
class Body:
    """A fitted grid that is ready to move.

    Parameters
    ----------
    name : str
        Name for the table.
    model : FittedModel
        Its fit, with the residual: the grid that is judged is the user's.
    mesh : MovingMesh
        The control mesh.
    target : Shape, optional
        A shape that its surface may become.
    """

    name: str
    model: FittedModel
    mesh: MovingMesh
    target: Shape | None = None

    @classmethod
    def of(cls, name: str, grid: Grid, n_control=None, target: Shape | None = None) -> Body:
        """Fit a grid as it is done without any option."""
        model = fit_grid(with_patches(grid), n_control=n_control)
        mesh = moving_mesh(model)
        if not mesh.is_free.any():
            raise InputError("no control point is free")
        return cls(name, model, mesh, target)

    @cached_property
    def quality(self) -> GridQuality:
        """Cells of the grid before any move."""
        return GridQuality.of_baseline(self.model.regenerate())

    @property
    def falls_back(self) -> bool:
        """Whether control points fall back on a quasi-interpolant, since least squares fold."""
        return self.model.candidate_weights is not None

    def requests(self, deformations: Sequence[str]) -> list[str]:
        """What can be asked of the body by name: its own shape, if it has one, and deformations."""
        return [*(["shape"] if self.target is not None else []), *deformations]

    def surface(self, request: str) -> np.ndarray:
        """Place the surface control points, shape (n_surface, 3), where a request wants them (m).

        Raises
        ------
        InputError
            If the surface leaves a plane of symmetry or the box around the grid, whose outer boundary stays, or has no
            such direction.
        """
        if request == "shape":
            return fit_shape(self.model, self.mesh.surface_ids, self.target)
        points = self.mesh.points
        surface = parse_deformation(request, self.model, self.mesh).apply(points[self.mesh.surface_ids])
        beyond = np.maximum(surface - points.max(axis=0), points.min(axis=0) - surface).max()
        if beyond > 1e-6 * self.mesh.size:
            raise InputError(f"the surface would leave the box around the grid by {beyond:.3g} m")
        return surface

    def judge(self, points: np.ndarray) -> tuple[int, float]:
        """Count the cells that moved control points invert, and find the smallest Q; of cells that were valid."""
        return judged(self.quality, self.model.regenerate(points).to_vector().reshape(-1, 3))[:2]


def judged(quality: GridQuality, nodes: np.ndarray) -> tuple[int, float, float]:
    """Count the cells that nodes, shape (n_nodes, 3), invert; smallest Q of those valid before, and mean Q of all."""
    n_inverted, q_min, total = 0, np.inf, 0.0
    for block, measures in zip(quality.blocks, quality.cells(nodes)):
        was_valid = np.ones(measures.q.size, dtype=bool)
        was_valid[block.was_invalid] = False
        n_inverted += int(np.count_nonzero(was_valid & ~measures.is_valid.ravel()))
        q_min = min(q_min, float(np.min(measures.q.ravel(), where=was_valid, initial=np.inf)))
        total += float(measures.q.sum())
    return n_inverted, q_min, total / quality.n_cells
