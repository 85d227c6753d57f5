"""Cures of a move that inverts cells: other options, tried one after another; only tried ones are suggested.

The first trials release the boundary on which inverted cells lie. Each trial repeats the whole move; the first that
inverts no cell is the last, and there are at most five.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from ...base.text import counted
from ...core.mesh.boundary import boundary_points, matching_patches, wall_patches
from ...core.mesh.moving_mesh import MovingMesh
from ...errors import InputError, MovementError
from ...grids.topology.topology import Topology
from .movers import MoverOptions
from .output import print_lines

__all__ = ["Trial", "proposals", "try_cures", "try_each", "verdict"]

MANY = 10
"""Increments of elasticity to try: a control mesh that tangles with fewer may not tangle."""

LET_GO = ("farfield", "other")
"""Kinds of patches that can be released without changing the shape of a body or the flow's symmetry."""


@dataclass(frozen=True)
class Trial:
    """Text to type for other options, and the number of cells that they invert; None if they cannot be used."""

    text: str
    n_inverted: int | None

    def __str__(self) -> str:
        return f"{self.text} ({'refused' if self.n_inverted is None else counted(self.n_inverted, 'cell')})"


def proposals(
    options: Any,  # how the move was made
    topology: Topology,  # the patches of the grid
    mesh: MovingMesh,  # the moved mesh
    adjacent: Sequence[str],  # patches on which inverted cells lie
) -> Iterator[tuple[str, Any]]:
    """Yield text to type, and the options with it: changes that may cure a move and are not yet in use."""
    free = _following(topology, mesh)
    yield from _boundary(options, topology, [name for name in adjacent if name not in free])
    mover = options.mover
    if not mover.comoving:
        yield "--comoving", replace(options, mover=replace(mover, comoving=True))
    if mover.mover != "elasticity":
        many = MoverOptions("elasticity", MANY, comoving=mover.comoving)
        yield f"--mover elasticity --increments {MANY}", replace(options, mover=many)
    elif (mover.increments or 1) < MANY:
        yield f"--increments {MANY}", replace(options, mover=replace(mover, increments=MANY))
    default = MoverOptions(comoving=mover.comoving)
    if mover.mover != default.mover:
        settings = ("increments", "nu", "stiffness", "solver")
        given = [f"--{name}" for name in settings if getattr(mover, name) is not None]
        words = [f"--mover {default.mover}", *(f"no {option}" for option in given)]
        yield " ".join(words), replace(options, mover=default)


def _following(topology: Topology, mesh: MovingMesh) -> set[str | None]:
    """Patches whose faces all follow the design surface: there is nothing to release."""
    free = [ids for _, ids in mesh.following]
    follows = np.isin(np.arange(mesh.n_points), np.concatenate([np.zeros(0, dtype=int), *free]))
    parts = list(boundary_points(topology, mesh.blocks))
    return {face.patch for face, _ in parts} - {face.patch for face, ids in parts if not follows[ids].all()}


def _boundary(options: Any, topology: Topology, adjacent: Sequence[str]) -> Iterator[tuple[str, Any]]:
    """Release patches that are fixed or slide, and let undeformed planar walls slide."""
    kinds = {face.patch: face.kind for face in topology.boundary}
    taken = matching_patches(topology, (*(options.design or wall_patches(topology)), *options.release))
    left = [name for name in adjacent if name not in taken]
    fixing = [pattern for pattern in options.fix if any(fnmatchcase(name, pattern) for name in left)]
    left = [name for name in left if not any(fnmatchcase(name, pattern) for pattern in fixing)]
    released = [name for name in left if kinds[name] in LET_GO]
    sliding = [pattern for pattern in options.slide if any(fnmatchcase(name, pattern) for name in released)]
    if fixing or released:
        kept = {
            "fix": tuple(pattern for pattern in options.fix if pattern not in fixing),
            "slide": tuple(pattern for pattern in options.slide if pattern not in sliding),
            "release": (*options.release, *released),
        }
        words = [f"--release {name}" for name in released]
        words += [f"no --fix {pattern}" for pattern in fixing] + [f"no --slide {pattern}" for pattern in sliding]
        yield " ".join(words), replace(options, **kept)
    slides = matching_patches(topology, options.slide)
    walls = [name for name in left if kinds[name] == "wall" and name not in slides]
    if walls:
        yield " ".join(f"--slide {name}" for name in walls), replace(options, slide=(*options.slide, *walls))


def try_cures(
    options: Any, topology: Topology, mesh: MovingMesh, adjacent: Sequence[str], count: Callable[[Any], int]
) -> list[Trial]:
    """Try `proposals` until one inverts no cell; ``count`` makes a move and counts the cells that it inverts."""
    return try_each(proposals(options, topology, mesh, adjacent), count)


def try_each(
    attempts: Iterable[tuple[str, Any]],  # what to type, and what ``count`` makes of it
    count: Callable[[Any], int],  # makes a move and counts the cells that it inverts
) -> list[Trial]:
    """Make trial moves, which may take minutes and are announced, until one inverts no cell."""
    trials: list[Trial] = []
    for text, changed in attempts:
        print_lines([f"the move inverts cells; trying {text}"])
        try:
            trials.append(Trial(text, count(changed)))
        except (InputError, MovementError):
            trials.append(Trial(text, None))
        if trials[-1].n_inverted == 0:
            break
    return trials


def verdict(trials: Sequence[Trial]) -> str:
    """Say what cures a move, as found by trying, or that nothing tried does."""
    cures = [trial.text for trial in trials if trial.n_inverted == 0]
    others = ", ".join(str(trial) for trial in trials if trial.n_inverted != 0)
    if cures:
        return f"tried, and no cell is inverted: {cures[0]}{f'; tried in vain: {others}' if others else ''}"
    return f"nothing that was tried helps: {others}; deform it less" if others else "deform it less"
