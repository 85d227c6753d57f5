"""The state of a page: a model, the current design and its shape, and the actions of the buttons.

Nothing here knows of a browser. If a shape cannot be made, the last valid one stays, with the reason.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import openmdao.api as om

from ...base.text import counted
from ...errors import InputError, MovementError
from ...grids.cells.wall_heights import KEPT
from .history import Design, History
from .outputs import free_name, write_shape
from .part import Part
from .shape import LiveModel, Shape

__all__ = ["Row", "Session"]

THINNER = 0.99
"""A section is shown as thinner below this fraction of its original thickness."""

_WRONG = (InputError, MovementError, om.AnalysisError, OSError)


class Row(NamedTuple):
    """A number as the page shows it."""

    name: str
    value: str
    was: str  # on the baseline
    is_bad: bool = False


class Session:
    """A model that is being deformed."""

    def __init__(self, live: LiveModel, folder: Path) -> None:
        self.live, self.folder = live, folder
        self.history = History(live.neutral)
        self.shape = self.baseline = live.at(live.neutral)
        self.complaint = ""  # why the current design has no shape
        self.picked: int | None = None  # row of the selected control point
        if live.first != live.neutral:
            self.history.change(live.first, None)
            self.update()

    @property
    def design(self) -> Design:
        """The current design."""
        return self.history.now

    def set(self, number: int, value: float) -> None:
        """Set a slider to a value within its range."""
        slider = self.live.sliders[number]
        value = round(min(max(float(value), slider.low), slider.high), 10)
        self.history.change(self.design.with_value(number, value), slider)

    def pull(self, displacement: tuple[float, float, float]) -> None:
        """Set the selected control point to a displacement (m)."""
        if self.picked is not None:
            x, y, z = (round(float(each), 12) for each in displacement)
            self.history.change(self.design.with_pull(self.picked, (x, y, z)), self.picked)

    def nudge(self, height: float) -> None:
        """Pull the selected control point along its normal by a height (m), from where it is."""
        if self.picked is not None:
            there = np.array(self.displacement) + height * self.live.normals[self.picked]
            self.pull((there[0], there[1], there[2]))

    @property
    def displacement(self) -> tuple[float, float, float]:
        """Displacement of the selected control point (m)."""
        none = (0.0, 0.0, 0.0)
        return none if self.picked is None else self.design.displacements.get(self.picked, none)

    def reset(self) -> None:
        """Return to the model, as a step that can be undone."""
        self.history.change(self.live.neutral, None)
        self.history.settle()

    def update(self, part: Part | None = None) -> bool:
        """Make the shape of the current design, or a part of it; False if that fails."""
        return self._try(lambda: self.live.at(self.design, False, part))

    def complete(self) -> bool:
        """Make all of the current shape, and solve the flow about it; False if that fails."""
        return self._try(lambda: self.live.completed(self.shape))

    def _try(self, make: Callable[[], Shape]) -> bool:
        try:
            self.shape = make()
        except _WRONG as error:
            self.complaint = " ".join(str(error).split())
            return False
        self.complaint = ""
        return True

    def write(self, suffix: str) -> str:
        """Write the current shape under an unused name; say what was written, or why nothing was."""
        if self.shape.part is not None and not self.complete():
            return f"nothing was written: {self.complaint}"
        source = self.live.model.file if self.live.study is None else self.live.study.shape.study.source
        stem = f"{source.stem if source else 'model'}_live"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            written = write_shape(free_name(self.folder, stem, suffix), self.live, self.shape)
        except _WRONG as error:
            return f"nothing was written: {' '.join(str(error).split())}"
        return f"{', '.join(map(str, written))} written"

    @property
    def command(self) -> str:
        """The command that makes the current grid; empty if no words describe it."""
        words = self.live.words(self.shape.design)
        return f"--deform {words}" if words and not self.shape.design.pulls else ""

    @property
    def warning(self) -> str:
        """What is wrong with the shape; empty if nothing is."""
        if not self.shape.n_inverted:
            return ""
        worst = int(self.shape.worst[0])
        return (
            f"{counted(self.shape.n_inverted, 'cell')} inverted that were not, the worst {self.live.place_of(worst)}: "
            f"move would refuse this grid"
        )

    def rows(self) -> list[Row]:
        """Numbers of the shape, next to the baseline's."""
        now, was = self.shape, self.baseline
        rows = [
            Row("largest displacement", f"{now.largest_displacement(was.nodes):.4g}", "0"),
            Row("smallest Q", f"{now.q.min():.3f}", f"{was.q.min():.3f}"),
            Row("smallest corner", f"{now.corners.min():.3f}", f"{was.corners.min():.3f}", bool(now.n_inverted)),
            Row("inverted cells, new", f"{now.n_inverted:,}", "0", bool(now.n_inverted)),
        ]
        if now.heights.size:
            low, high = np.quantile(now.heights, [0.01, 0.99])
            is_off = bool(low < KEPT[0] or high > KEPT[1])
            rows.append(Row("first heights, 98 % within", f"{low:.3f} to {high:.3f}", "1", is_off))
        rows += [
            Row(f"t/c, {name}", f"{a:.4f}", f"{b:.4f}", bool(a < THINNER * b))
            for name, a, b in zip(self.live.thickness.names, now.thickness, was.thickness)
        ]
        if was.lift is not None:
            lift = "..." if now.lift is None else f"{now.lift:.4f}"
            of = self.live.lift
            rows.append(Row(f"lift, {of.alpha:g} deg, Mach {of.mach:g}", lift, f"{was.lift:.4f}"))
        return rows

    def worst_cells(self, most: int = 3) -> list[str]:
        """Name the worst cells."""
        return [f"{self.live.place_of(int(cell))}: {self.shape.corners[cell]:.3f}" for cell in self.shape.worst[:most]]

    def numbers(self) -> list[dict[str, Any]]:
        """Return `rows` for a page."""
        return [row._asdict() for row in self.rows()]
