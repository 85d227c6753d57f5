"""Algorithms that solve linear systems, run singly or several in step, with one pass over a factor for all.

An algorithm is a generator, here a *task*: it yields a factor and a right-hand side whenever it needs a solution,
receives the solution, and returns its result. It is written for one design. `solved` runs one; `solved_together` runs
several in step, and solves for all right-hand sides of one factor at once: a factor that does not fit into the cache is
read once for all of them. Solutions then agree to rounding, since BLAS sums in another order for several.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from ...errors import MovementError
from .blocks import LinearSolution

__all__ = ["Task", "solved", "solved_together"]

T = TypeVar("T")

Asked = tuple[Any, np.ndarray]
"""A factor, and a right-hand side for it."""

Task = Generator[Asked, LinearSolution, T]
"""An algorithm that requests solutions, and its result."""


def solved(task: Task[T]) -> T:
    """Result of one task; raises what it raises."""
    go_on: Any = task.send
    answer: LinearSolution | MovementError | None = None
    while True:
        try:
            factor, right = go_on(answer)
        except StopIteration as end:
            return end.value
        try:
            go_on, answer = task.send, factor.solve(right)
        except MovementError as error:
            go_on, answer = task.throw, error


def solved_together(tasks: Sequence[Task[T]]) -> list[T | MovementError]:
    """Result of each task, or the `MovementError` with which it ends; the others continue."""
    found: dict[int, T | MovementError] = {}
    answers: dict[int, LinearSolution | MovementError | None] = dict.fromkeys(range(len(tasks)))
    while answers:
        asked: dict[int, Asked] = {}
        for n, answer in answers.items():
            try:
                asked[n] = _answered(tasks[n], answer)
            except StopIteration as end:
                found[n] = end.value
            except MovementError as error:
                found[n] = error
        answers = _solutions(asked)
    return [found[n] for n in range(len(tasks))]


def _answered(task: Any, answer: LinearSolution | MovementError | None) -> Asked:
    """Next request of a task."""
    return task.throw(answer) if isinstance(answer, MovementError) else task.send(answer)


def _solutions(asked: Mapping[int, Asked]) -> dict[int, LinearSolution | MovementError | None]:
    """Solutions for all requests, treating one factor's together."""
    groups: dict[int, list[int]] = {}
    for n, (factor, _) in asked.items():
        groups.setdefault(id(factor), []).append(n)
    found: dict[int, LinearSolution | MovementError | None] = {}
    for members in groups.values():
        found |= zip(members, _of_one_factor(asked[members[0]][0], [asked[n][1] for n in members]))
    return found


def _of_one_factor(factor: Any, sides: Sequence[np.ndarray]) -> list[LinearSolution | MovementError]:
    """Solutions for right-hand sides; if a factor fails for all together, each is tried separately."""
    try:
        if len(sides) == 1:
            return [factor.solve(sides[0])]
        whole = factor.solve(np.stack(sides, axis=-1))
    except MovementError as error:
        return [error] if len(sides) == 1 else [_of_one_factor(factor, [side])[0] for side in sides]
    parts = np.ascontiguousarray(np.moveaxis(whole.x, -1, 0))
    return [LinearSolution(x, whole.iterations, whole.residual, whole.seconds) for x in parts]
