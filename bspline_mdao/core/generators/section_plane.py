"""Common parts of grids about sections: checks, nodes along lines, blocks one cell deep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import PchipInterpolator

from ...errors import InputError
from ...grids.topology.grid import Block, Grid, Patch
from ...grids.topology.index_space import Window
from .circle_mapping import CircleMapping
from .wing import Section

_KINDS = {"wing": "wall", "base": "wall", "farfield": "farfield", "symmetry": "symmetry"}


def mapping_of(
    section: Section,
    what: str,  # the kind of grid, for messages
    n_around: int,  # cells around and away
    n_away: int | None,
    far: float,  # distance of the outer boundary (chords)
) -> CircleMapping:
    """Map the exterior of a section; refuse requests that allow no grid."""
    if not section.nose_radius > 0.0:
        raise InputError(f"{what} about a section: the nose is sharp; give a Section with its nose_radius")
    if n_around < 8 or n_around % 2 or (n_away is not None and n_away < 4):
        away = "" if n_away is None else f" and {n_away} away from it"
        raise InputError(
            f"{what} about a section: {n_around} cells around it{away}; give an even number of 8 or more around, and 4 "
            f"or more away"
        )
    mapping = CircleMapping(section, n_around)
    if not far > 2.0 * mapping.radius:
        raise InputError(f"{what} about a section: the far field at {far:g} chords cuts it; give 2 or more")
    return mapping


def at_distances(
    line: np.ndarray,  # (m,), complex points of a line
    parameters: np.ndarray,  # (m,), their positive parameters, except the first one, which is 0
    distances: np.ndarray,  # (n,), positive distances along it from its first point
) -> np.ndarray:
    """Parameters (n,) of points of a line at distances from its beginning, near which steps follow a power law."""
    there = np.log(np.cumsum(np.abs(np.diff(line))))
    return np.exp(PchipInterpolator(there, np.log(parameters[1:]))(np.log(distances)))


def one_deep(
    planes: Mapping[str, np.ndarray],  # complex nodes (ni, nj) of each block by its name
    faces: Mapping[str, Sequence[tuple[int, int]]],  # block and face of each patch, except the planes
    source: str,
) -> Grid:
    """Make the grid of blocks from z = 0 to z = 1."""
    blocks = tuple(Block(_between_planes(plane), name) for name, plane in planes.items())
    faces = {**faces, "symmetry": [(number, face) for number in range(len(blocks)) for face in (4, 5)]}
    windows = [Window.whole(number, block.shape) for number, block in enumerate(blocks)]
    patches = tuple(
        Patch(name, kind, tuple(windows[number].face(face) for number, face in faces[name]))
        for name, kind in _KINDS.items()
        if name in faces
    )
    return Grid(blocks, patches, source=source)


def _between_planes(points: np.ndarray) -> np.ndarray:
    """Nodes (ni, nj, 2, 3) from complex nodes of a plane."""
    nodes = np.empty((*points.shape, 2, 3))
    nodes[..., 0], nodes[..., 1], nodes[..., 2] = points.real[..., None], points.imag[..., None], (0.0, 1.0)
    return nodes
