"""Designs that were tried, to go back and forth between them.

A design is the values of the sliders and the control points that were pulled by hand. Successive changes of the same
thing, as a slider makes them while it is dragged, are one step back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

__all__ = ["Design", "History"]


@dataclass(frozen=True)
class Design:
    """The values and displacements that define a shape."""

    values: tuple[float, ...]  # of the sliders
    # displacements (m) of control points by their rows on the design surface, in ascending order
    pulls: tuple[tuple[int, tuple[float, float, float]], ...] = ()

    def with_value(self, number: int, value: float) -> Design:
        """Return the design with another value of a slider."""
        return replace(self, values=(*self.values[:number], float(value), *self.values[number + 1 :]))

    def with_pull(self, row: int, displacement: tuple[float, float, float]) -> Design:
        """Return the design with a control point at another displacement; None removes it."""
        pulls = dict(self.pulls)
        pulls[row] = displacement
        kept = (item for item in sorted(pulls.items()) if any(item[1]))
        return replace(self, pulls=tuple(kept))

    @property
    def displacements(self) -> Mapping[int, tuple[float, float, float]]:
        """Displacements of control points by their rows."""
        return dict(self.pulls)


@dataclass
class History:
    """The current design, those before it, and those that were undone."""

    now: Design
    before: list[Design] = field(default_factory=list)
    after: list[Design] = field(default_factory=list)
    changing: object = None  # what the last change was of; None if the next one is a step of its own

    def change(self, design: Design, what: object) -> None:
        """Go to a design; successive changes of the same thing are one step."""
        if design == self.now:
            return
        if what is None or what != self.changing:
            self.before.append(self.now)
        self.now, self.changing = design, what
        self.after.clear()

    def settle(self) -> None:
        """End a step: the slider was released."""
        self.changing = None

    def undo(self) -> bool:
        """Go one step back; False if there is none."""
        return self._go(self.before, self.after)

    def redo(self) -> bool:
        """Redo the last undone step; False if there was none."""
        return self._go(self.after, self.before)

    def _go(self, there: list[Design], here: list[Design]) -> bool:
        if not there:
            return False
        here.append(self.now)
        self.now, self.changing = there.pop(), None
        return True
