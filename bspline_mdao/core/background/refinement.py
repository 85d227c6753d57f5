"""A lattice refined for known moves, until its distance from the walls is small enough for the cells above them.

The distance between lattice and walls fades over a reach around them, which strains cells by the ratio of the two.
Where that is more than they can absorb, spans are halved. These spans are found once, from known moves, so all designs
share one lattice, and the mesh stays a smooth function of them.

A lattice closer to the walls is not always better for the cells farther away, so `MeshModel.refined_for` chooses among
the lattices by the cells that they invert.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from .background_lattice import BackgroundLattice
from .lattice_settings import LatticeSettings
from .lattice_spans import WITHOUT_ASKING, factor_bytes
from .thin_plate import ThinPlate

__all__ = ["narrower", "refinements", "strain_at_walls"]

CARRIED = 0.02
"""Allowed distance between lattice and wall, relative to the distance over which it fades. Smallest volumes at a bump
of a twentieth of a channel's length, raised to twice its height, are 0.69 without refinement, 0.72 with 0.05, and 0.82
with this value."""

ROUNDS = 5
"""Maximum number of halvings."""

WORTH = 0.9
"""Ratio of largest strains below which halving is worthwhile: otherwise stiffness keeps the lattice off the walls."""


def refinements(
    mover_of: Callable[[LatticeSettings], ThinPlate],  # mover of the lattice with given settings, with all walls
    settings: LatticeSettings,  # settings of the lattice to refine
    changes: Sequence[np.ndarray],  # displacements of wall nodes, shape (n_walls, 3), to follow (m)
    reach: float,  # distance over which the error fades (m)
) -> list[LatticeSettings]:
    """Settings from a lattice to one that follows walls well enough, by halving; as long as that helps and fits."""
    found, mover = [settings], mover_of(settings)
    strains = strain_at_walls(mover, changes, reach)
    for _ in range(ROUNDS):
        if strains.max() <= CARRIED:
            break
        points = mover.wall_points[strains > CARRIED]
        finer = replace(settings, refined=settings.refined + narrower(mover.lattice, points))
        next_mover = mover_of(finer)
        if factor_bytes(next_mover.lattice) > max(WITHOUT_ASKING, factor_bytes(mover.lattice)):
            break
        left = strain_at_walls(next_mover, changes, reach)
        if left.max() > WORTH * strains.max():
            break
        settings, mover, strains = finer, next_mover, left
        found.append(settings)
    return found


def strain_at_walls(mover: ThinPlate, changes: Sequence[np.ndarray], reach: float) -> np.ndarray:
    """Largest error of the lattice at each wall node, relative to its fading distance, shape (n_walls,)."""
    found = np.zeros(mover.n_walls)
    for change in changes:
        missed = mover.missed(change)
        np.maximum(found, np.linalg.norm(missed, axis=1) / reach, out=found)
    return found


def narrower(lattice: BackgroundLattice, points: np.ndarray) -> tuple[tuple[int, float, float, float], ...]:
    """Halve the spans that contain wall points, shape (n, 3), see `LatticeSettings.refined`."""
    # In all directions: short features along a wall must fade over a short distance across it.
    found = []
    for axis, (line, places) in enumerate(zip(lattice.lines, lattice.frame.to_local(points).T)):
        if not line.is_tied:
            spans = np.unique(line.spans(places))
            ends = zip(line.breaks[spans].tolist(), line.breaks[spans + 1].tolist())
            found += [(axis, low, high, 0.5 * (high - low)) for low, high in ends]
    return tuple(found)
