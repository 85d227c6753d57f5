"""Deformations by name: what the command line and the studies of robustness ask for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..mesh.frame import Frame, Plane, surface_frame
from ..mesh.mesh import MovingMesh
from ..model.fitted_model import FittedModel
from ..topology.index_space import Window
from .bumps import random_bumps
from .deformation import Deformation, planes_of
from .parsing import Request, parse_requests
from .point_maps import Bend, Dihedral, Pitch, PointMap, ScaleChord, ScaleThickness, Stretch, Sweep, Translate, Twist
from .points_file import SUFFIXES, GivenPoints, read_points

__all__ = ["DEFORMATIONS", "parse_deformation", "wall_spacing"]


_INBOARD = 0.1
"""Points from this part of the span inboard of an arc tell how thick the surface is on it."""


@dataclass(frozen=True, eq=False)
class _Surface:
    """What a deformation may need to know of the surface as it is when its turn comes."""

    model: FittedModel
    points: np.ndarray
    planes: tuple[Plane, ...]

    @cached_property
    def frame(self) -> Frame:
        return surface_frame(self.points, self.planes)


def parse_deformation(spec: str | Sequence[str], model: FittedModel, mesh: MovingMesh) -> Deformation:
    """Make the deformation that words ask for.

    Parameters
    ----------
    spec : str or sequence of str
        Deformations joined by ``+``, done one after the other; several are joined as well. Each is a name out of
        `DEFORMATIONS` with its value, ``bend=120deg@0.7``, or a file of new surface points (``.csv``, ``.dat``,
        ``.npy``, ``.txt``) in the order of ``mesh.surface_ids``.
    model : FittedModel
        The fitted grid, for lengths in cells.
    mesh : MovingMesh
        Its control mesh (`moving_mesh`); the deformation is of its surface.

    Returns
    -------
    Deformation
        Lengths, spans and directions are those of the surface as it is when the turn of each comes.

    Raises
    ------
    InputError
        If the words are not understood, or a file is not what it should be.

    Examples
    --------
    >>> from bspline_mdao import fit_grid, flat_plate_grid
    >>> from bspline_mdao.mesh.boundary import moving_mesh
    >>> model = fit_grid(flat_plate_grid((9, 9, 9)), n_control=(5, 5, 5))
    >>> mesh = moving_mesh(model)
    >>> deformation = parse_deformation("stretch=2+bend=120deg@0.7", model, mesh)
    >>> points = deformation.apply(mesh.points[mesh.surface_ids])
    """
    texts = [spec] if isinstance(spec, str) else list(spec)
    if not any(text.strip() for text in texts):
        raise InputError(f"deformation: nothing is asked for; the names are {', '.join(DEFORMATIONS)}")
    points, planes, maps = mesh.points[mesh.surface_ids], planes_of(mesh), []
    for request in [request for text in texts for request in _requests(text)]:
        maps.append(_make(request, _Surface(model, points, planes)))
        points = maps[-1].apply(points)
    return Deformation(mesh, tuple(maps))


def wall_spacing(model: FittedModel) -> float:
    """Find the median height of the cells at the walls of a model's grid (m).

    Raises
    ------
    InputError
        If no patch is a wall.
    """
    blocks = model.regenerate().blocks
    walls = [face.window for face in model.topology.boundary if face.kind == "wall"]
    heights = [_first_heights(blocks[window.block].nodes, window) for window in walls]
    if not heights:
        raise InputError(f"{model.header.source}: no patch is a wall, so it has no cell height; give the height in m")
    return float(np.median(np.concatenate(heights)))


def _first_heights(nodes: np.ndarray, window: Window) -> np.ndarray:
    """Heights of the cells of a block on a face window."""
    flat, part = window.shape.index(1), list(window.slices)
    part[flat] = slice(0, 2) if window.lo[flat] == 0 else slice(-2, None)
    return np.linalg.norm(np.diff(nodes[tuple(part)], axis=flat), axis=-1).ravel()


def _requests(text: str) -> list[Request | Path]:
    return [Path(text)] if Path(text).suffix.lower() in SUFFIXES else parse_requests(text)


def _make(request: Request | Path, surface: _Surface) -> PointMap:
    if isinstance(request, Path):
        return GivenPoints(read_points(request, len(surface.points)))
    if request.name not in DEFORMATIONS:
        raise request.fail(f"no deformation is called '{request.name}'; the names are {', '.join(DEFORMATIONS)}")
    return DEFORMATIONS[request.name](request, surface)


def _by_angle(make, limit=360.0):
    """Deformation by an angle alone."""

    def build(request: Request, surface: _Surface) -> PointMap:
        request.only()
        return make(surface.frame, request.angle(limit))

    return build


def _by_factor(make):
    """Deformation by a positive factor alone."""

    def build(request: Request, surface: _Surface) -> PointMap:
        request.only()
        return make(surface.frame, request.number(low=0.0))

    return build


def _bend(request: Request, surface: _Surface) -> Bend:
    request.only("@", "length")
    at = request.number("@", 0.7, low=-1e-12, high=1.0)
    length = request.number("length", min(0.15, 1.0 - at), low=0.0, high=1.0 + 1e-12)
    bend = Bend(surface.frame, request.angle(), at, length)
    _, normal, span = surface.frame.to_local(surface.points).T
    is_outboard = span >= (at - _INBOARD) * surface.frame.span
    highest = float(np.max(np.sign(bend.amount) * bend.height(normal[is_outboard]), initial=0.0))
    if highest * abs(bend.amount) >= length * surface.frame.span:
        least = highest * abs(bend.amount) / surface.frame.span
        raise request.fail(
            f"the arc is too tight for a surface {highest:.3g} m above its middle; give a length above {least:.2g}"
        )
    return bend


def _pitch(request: Request, surface: _Surface) -> Pitch:
    request.only("@")
    return Pitch(surface.frame, request.angle(), request.number("@", 0.25))


def _translate(request: Request, surface: _Surface) -> Translate:
    request.only()
    return Translate(np.array(request.vector()))


def _bumps(request: Request, surface: _Surface) -> PointMap:
    request.only("seed", "wavelength")
    cells = request.value.removesuffix("cells")
    unit = wall_spacing(surface.model) if cells != request.value else 1.0
    height = Request(request.text, request.name, cells.strip(), None, {}).number(low=0.0)
    seed = request.number("seed", 0.0, low=-0.5)
    wavelength = request.number("wavelength", 0.5 * surface.frame.chord, low=0.0)
    return random_bumps(surface.points, height * unit, wavelength, int(seed), surface.planes)


DEFORMATIONS = {
    "twist": _by_angle(Twist, math.inf),
    "bend": _bend,
    "stretch": _by_factor(Stretch),
    "chord": _by_factor(ScaleChord),
    "thickness": _by_factor(ScaleThickness),
    "sweep": _by_angle(Sweep, 85.0),
    "dihedral": _by_angle(Dihedral, 85.0),
    "pitch": _pitch,
    "translate": _translate,
    "bumps": _bumps,
}
"""Deformations by name, each made of a request and a surface."""
