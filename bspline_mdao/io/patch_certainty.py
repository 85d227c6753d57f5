"""How sure a guess at a patch is: whether the place of its faces and the cells beside them say the same.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..topology.grid import Grid, Patch
from ..topology.index_space import Window
from ..topology.periodic import Motion, find_periodic
from .patch_guess import FAR, GridFrame

__all__ = ["SURENESS", "Certainty", "how_sure"]

SURENESS = ("sure", "likely", "unsure")
"""How sure a guess can be, the surest first."""

FINE, COARSE = 0.5, 2.0
"""First cells below and above these parts of the mean of their grid line are those of walls, and of far fields."""

VERY_FINE = 0.2
"""First cells below this part of the mean of their grid line are rarely those of a plane of symmetry."""

CLEARLY = 1.5
"""A face is clearly far, or near, where its distance is that many times the limit of far fields, or less by that."""


@dataclass(frozen=True)
class Certainty:
    """How sure a guess is.

    Parameters
    ----------
    level : str
        One of `SURENESS`: that of the face that is least so.
    reason : str
        Why, of that face.
    window : Window
        That face.
    n_windows : dict of str to int
        How many faces are how sure.
    """

    level: str
    reason: str
    window: Window
    n_windows: dict[str, int]


def how_sure(grid: Grid, patches: Sequence[Patch]) -> tuple[Certainty, ...]:
    """Judge guesses at patches.

    Places are what `bspline_mdao.io.patch_guess.guess_patches` goes by. The cells beside a face know nothing of them:
    towards walls they are finer than elsewhere on their grid lines, as a rule, towards the far field coarser.

    Parameters
    ----------
    grid : Grid
        The grid.
    patches : sequence of Patch
        What `guess_patches` makes of its boundary.

    Returns
    -------
    tuple of Certainty
        One of each patch.
    """
    frame = GridFrame.of(grid)
    periodic = [window for patch in patches if patch.kind == "other" for window in patch.windows]
    motions = {w: pair.motion for pair in find_periodic(grid, periodic) for w in (*pair.windows, *pair.others)}
    found = []
    for patch in patches:
        judged = [(*_judge(grid, patch.kind, window, frame, motions.get(window)), window) for window in patch.windows]
        level, reason, window = max(judged, key=lambda item: SURENESS.index(item[0]))
        levels = [item[0] for item in judged]
        found.append(Certainty(level, reason, window, {name: levels.count(name) for name in SURENESS}))
    return tuple(found)


def _judge(grid: Grid, kind: str, window: Window, frame: GridFrame, motion: Motion | None) -> tuple[str, str]:
    """Say how sure the guess at a window is, and why."""
    if motion:  # translations lay faces onto each other in every duct of parallel walls, rotations seldom by chance
        return ("likely" if motion.is_translation else "sure"), f"a {motion} lays it onto its partner"
    part = _first_cells(grid, window)
    if kind == "symmetry":
        return _judge_symmetry(part)
    distance = frame.distance(grid.blocks[window.block].nodes[window.slices]) / FAR
    reason = f"{distance:.2g} of the distance that is far" + _cells_text(part)
    is_fine, is_coarse = part is not None and part < FINE, part is not None and part > COARSE
    agrees, contradicts = (is_coarse, is_fine) if kind == "farfield" else (is_fine, is_coarse)
    is_clear = distance > CLEARLY if kind == "farfield" else distance < 1.0 / CLEARLY
    if contradicts or not (is_clear or agrees):
        return "unsure", reason
    return ("sure" if is_clear and agrees else "likely"), reason


def _judge_symmetry(part: float | None) -> tuple[str, str]:
    """Planes at the rim may be walls as well: a plate, the floor of a tunnel."""
    if part is None:
        return "sure", "a plane at the rim of a block of few cells across"
    is_fine = part < VERY_FINE
    return ("unsure" if is_fine else "likely"), f"a plane at the rim{_cells_text(part)}{', as at walls' * is_fine}"


def _cells_text(part: float | None) -> str:
    return "" if part is None else f"; first cells {part:.2g} of the mean of their lines"


def _first_cells(grid: Grid, window: Window) -> float | None:
    """Median height of the first cells at a window by the mean of their grid lines; None in blocks of few cells."""
    nodes = grid.blocks[window.block].nodes
    flat = [d for d in range(3) if window.lo[d] == window.hi[d]]
    axis = max(flat, key=lambda d: nodes.shape[d])
    if nodes.shape[axis] < 4:
        return None
    ranges = tuple(slice(lo, hi + 1) for lo, hi in zip(window.lo, window.hi))
    lines = np.moveaxis(nodes[tuple(slice(None) if d == axis else ranges[d] for d in range(3))], axis, 0)
    heights = np.linalg.norm(np.diff(lines[:: -1 if window.lo[axis] else 1], axis=0), axis=-1)
    means = heights.mean(axis=0)
    is_line = means > 0.0
    return float(np.median(heights[0][is_line] / means[is_line])) if is_line.any() else None
