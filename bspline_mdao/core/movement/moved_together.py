"""Several moves from the same points, and several products, with one pass over each factor for all of them.

Sampled designs, and batches in other frameworks, are many surfaces for one mesh. A mover whose ``move`` is a task
(``move_task``, see `bspline_mdao.base.sparse.solved_together`) makes them in step, and so do movements with
``jvp_task`` and ``vjp_task``. Others move one after the other. The results are the same to rounding, whichever moves
are made together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.sparse.solved_together import solved_together
from ...errors import MovementError
from .mover import Movement, Mover

__all__ = ["TOGETHER", "goes_together", "jvps_together", "moved_together", "vjps_together"]

TOGETHER = 16
"""Moves to make in step: a right-hand side then takes a quarter of its single time, and twice as many save a tenth."""


def goes_together(mover: Mover) -> bool:
    """Whether moves of a mover, and products of its movements, take less time together."""
    return hasattr(mover, "move_task")


def moved_together(
    mover: Mover,
    initial: np.ndarray,  # (n_points, 3), points of the mesh before all of the moves (m)
    surfaces: Sequence[np.ndarray],  # surface points after each of them, (n_surface, 3) (m)
    start: Any = None,  # from an earlier movement from these points
) -> list[Movement | MovementError]:
    """Make several moves; a move that fails is replaced by its error."""
    settings: Any = mover
    if start is None and hasattr(settings, "start"):
        try:
            start = settings.start(initial)
        except MovementError as error:
            return [error] * len(surfaces)
    options = {} if start is None else {"start": start}
    return _called("move", [settings] * len(surfaces), [(initial, surface) for surface in surfaces], **options)


def jvps_together(
    movements: Sequence[Movement], d_initials: Sequence[np.ndarray], d_surfaces: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Forward products of movements, of which one may stand for several."""
    return _sound(_called("jvp", movements, list(zip(d_initials, d_surfaces))))


def vjps_together(movements: Sequence[Movement], bars: Sequence[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Transposed products of movements, of which one may stand for several."""
    return _sound(_called("vjp", movements, [(bar,) for bar in bars]))


def _called(name: str, of: Sequence[Any], given: Sequence[tuple], **options: Any) -> list:
    """Results of a method, or its errors: in step if all have a task for it."""
    if all(hasattr(each, f"{name}_task") for each in of):
        return solved_together([getattr(each, f"{name}_task")(*args, **options) for each, args in zip(of, given)])
    found: list = []
    for each, args in zip(of, given):
        try:
            found.append(getattr(each, name)(*args, **options))
        except MovementError as error:
            found.append(error)
    return found


def _sound(found: list) -> list:
    """Results, raising the first error among them."""
    error = next((each for each in found if isinstance(each, MovementError)), None)
    if error is not None:
        raise error
    return found
