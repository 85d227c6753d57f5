"""A lattice refined for moves that are known: until it misses the walls by less than what is above them can carry.

What a lattice misses of the walls fades over a reach around them, which strains cells by the one over the other. Where
that is more than they carry, spans are halved. Which spans these are is found once, from moves that are known, so that
designs move by one lattice, and the mesh stays a smooth function of them.

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

__all__ = ["narrower", "refined_settings", "strain_at_walls"]

CARRIED = 0.02
"""What a lattice may miss of a wall, by the distance over which that fades. Smallest volumes at a bump of a twentieth
of a channel's length, twice as high as it was, are 0.69 where nothing is refined, 0.72 with 0.05, and 0.82 with
this."""

ROUNDS = 5
"""How often spans are halved, at most."""

WORTH = 0.9
"""What halving has to leave of the largest strain: where walls are met no better, stiffness keeps the lattice off."""


def refined_settings(
    mover_of: Callable[[LatticeSettings], ThinPlate],  # what moves the lattice of some settings behind all walls
    settings: LatticeSettings,  # those of the lattice to refine
    changes: Sequence[np.ndarray],  # displacements of the nodes of walls, shape (n_walls, 3), that it is to follow (m)
    reach: float,  # distance over which fades what it misses (m)
) -> LatticeSettings:
    """Halve spans until a lattice follows walls well enough, and no further than that helps or memory allows."""
    mover = mover_of(settings)
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
    return settings


def strain_at_walls(mover: ThinPlate, changes: Sequence[np.ndarray], reach: float) -> np.ndarray:
    """What a lattice misses of each node of walls, at most, by the distance over which that fades, shape (n_walls,)."""
    found = np.zeros(mover.n_walls)
    for change in changes:
        missed = mover.missed(change)
        np.maximum(found, np.linalg.norm(missed, axis=1) / reach, out=found)
    return found


def narrower(lattice: BackgroundLattice, points: np.ndarray) -> tuple[tuple[int, float, float, float], ...]:
    """Halve the spans that points of walls, shape (n, 3), are in, see `LatticeSettings.refined`."""
    # In all directions: what is short along a wall has to fade over as short a way across it.
    found = []
    for axis, (line, places) in enumerate(zip(lattice.lines, lattice.frame.to_local(points).T)):
        if not line.is_tied:
            spans = np.unique(line.spans(places))
            ends = zip(line.breaks[spans].tolist(), line.breaks[spans + 1].tolist())
            found += [(axis, low, high, 0.5 * (high - low)) for low, high in ends]
    return tuple(found)
