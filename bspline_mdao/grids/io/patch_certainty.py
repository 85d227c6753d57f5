"""Certainty of a guess at a patch: whether the place of its faces and the cells next to them agree.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..topology.index_space import Window
from ..topology.periodic_pair import Motion

__all__ = ["FAR", "FINE", "SURENESS", "Certainty", "FaceGuess", "how_sure", "place_of"]

SURENESS = ("sure", "likely", "unsure")
"""Levels of certainty, the highest first."""

FAR = 0.3
"""A face is far field if all of it is farther from the middle than this fraction of the farthest node's distance."""

FINE, COARSE = 0.5, 2.0
"""First cells below and above these fractions of the mean of their grid line belong to walls, and to far fields."""

VERY_FINE = 0.2
"""First cells below this fraction of the mean of their grid line are rarely at a plane of symmetry."""

CLEARLY = 1.5
"""A face is clearly far, or near, if its distance is the far-field limit times, or divided by, this factor."""

LINES = "the mean of their grid lines"
"""What first cells of structured grids are compared with."""


@dataclass(frozen=True)
class FaceGuess:
    """A guess at a face of the boundary."""

    window: Window  # the face
    name: str  # name of its guessed patch
    kind: str  # kind of that patch
    level: str  # certainty of the guess: one of `SURENESS`
    reason: str  # why


@dataclass(frozen=True)
class Certainty:
    """Certainty of a guess."""

    level: str  # one of `SURENESS`, for the least certain face
    reason: str  # why, for that face
    window: Window  # that face
    n_windows: dict[str, int]  # number of faces of each certainty


def how_sure(
    guesses: Sequence[FaceGuess],  # guesses; those of one name are consecutive
) -> tuple[Certainty, ...]:  # one for each name, in order
    """Summarise the certainty of guesses."""
    found = []
    for name in dict.fromkeys(guess.name for guess in guesses):
        faces = [guess for guess in guesses if guess.name == name]
        worst = max(faces, key=lambda guess: SURENESS.index(guess.level))
        levels = [guess.level for guess in faces]
        counts = {level: levels.count(level) for level in SURENESS}
        found.append(Certainty(worst.level, worst.reason, worst.window, counts))
    return tuple(found)


def judge_place(
    window: Window,  # the face
    distance: float,  # its distance, relative to the radius of the grid
    # height of its first cells relative to the mean of their grid lines, which is independent of its place: towards
    # walls they are usually finer, towards the far field coarser. None if there are few.
    part: float | None,
) -> FaceGuess:
    """Guess whether a face is wall or far field."""
    kind, level, reason = place_of(distance, part)
    return FaceGuess(window, kind, kind, level, reason)


def place_of(distance: float, part: float | None, of: str = LINES) -> tuple[str, str, str]:
    """Guess kind, level and reason from the distance from the middle, and check the first cells; see `judge_place`."""
    kind, far = ("farfield" if distance > FAR else "wall"), distance / FAR
    reason = f"distance from the middle {far:.2g} of the far-field limit" + _cells_text(part, of)
    is_fine, is_coarse = part is not None and part < FINE, part is not None and part > COARSE
    agrees, contradicts = (is_coarse, is_fine) if kind == "farfield" else (is_fine, is_coarse)
    is_clear = far > CLEARLY if kind == "farfield" else far < 1.0 / CLEARLY
    if contradicts or not (is_clear or agrees):
        return kind, "unsure", reason
    return kind, "sure" if is_clear and agrees else "likely", reason


def judge_symmetry(window: Window, name: str, part: float | None) -> FaceGuess:
    """Take a face for a plane of symmetry: such planes may be walls as well, a plate or the floor of a tunnel."""
    if part is None:
        return FaceGuess(window, name, "symmetry", "sure", "a plane at the rim of a block of few cells across")
    is_fine = part < VERY_FINE
    reason = f"a plane at the rim{_cells_text(part)}{', as at walls' * is_fine}"
    return FaceGuess(window, name, "symmetry", "unsure" if is_fine else "likely", reason)


def judge_periodic(window: Window, name: str, motion: Motion) -> FaceGuess:
    """Take a face for periodic: translations map the sides of any duct onto each other, rotations rarely by chance."""
    level = "likely" if motion.is_translation else "sure"
    return FaceGuess(window, name, "other", level, f"a {motion} maps it onto its partner")


def _cells_text(part: float | None, of: str = LINES) -> str:
    return "" if part is None else f"; first cells {part:.2g} of {of}"
