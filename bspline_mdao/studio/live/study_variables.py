"""Variables of a study as sliders, one for each value, and the study rewritten with the current values."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from ...base.display import OneLine
from ...errors import InputError
from ..study.shape_script import StudiedShape
from ..study.variable_kinds import VARIABLES
from .variables import Slider

__all__ = ["StudyVariables"]


MOST_SLIDERS = 100
"""Largest number of sliders on a page; further values stay at the start of the study."""


@dataclass(frozen=True, eq=False)
class StudyVariables(OneLine):
    """Variables of a study."""

    shape: StudiedShape
    sliders: tuple[Slider, ...]  # of the driver's values, the first `MOST_SLIDERS`
    places: tuple[tuple[str, int], ...]  # variable of each, and which of its values
    start: dict[str, np.ndarray]  # start values of the study, by names of variables
    n_values: int  # number of the driver's values

    @classmethod
    def of(cls, shape: StudiedShape) -> StudyVariables:
        """Make a slider for every value, between its bounds, extended to the baseline if this is outside."""
        found: list[tuple[Slider, tuple[str, int]]] = []
        start = {}
        for name, neutral in shape.parametrization.initial.items():
            table = shape.study.variables[name]
            start[name] = _spread(neutral if table["start"] is None else table["start"], len(neutral))
            numbers = [value - 1 for value in table.get("values") or range(1, len(neutral) + 1)]
            low, high = (_spread(table[key], len(numbers)) for key in ("lower", "upper"))
            low, high = np.minimum(low, neutral[numbers]), np.maximum(high, neutral[numbers])
            for number, least, most in zip(numbers, low.tolist(), high.tolist()):
                label = name if len(neutral) == 1 else f"{name} {number + 1}"
                slider = Slider(name, label, least, most, float(neutral[number]), VARIABLES[table["kind"]].units)
                found.append((slider, (name, number)))
        sliders, places = zip(*found[:MOST_SLIDERS])
        return cls(shape, sliders, places, start, len(found))

    @property
    def first(self) -> tuple[float, ...]:
        """Values of the sliders at the start of the study."""
        return tuple(float(self.start[name][number]) for name, number in self.places)

    def by_name(self, values: Sequence[float]) -> dict[str, np.ndarray]:
        """Values of all variables, by name, at values of the sliders."""
        found = {name: values.copy() for name, values in self.start.items()}
        for (name, number), value in zip(self.places, values):
            found[name][number] = value
        return found

    def is_baseline(self, values: Sequence[float]) -> bool:
        """Whether nothing moves."""
        initial = self.shape.parametrization.initial
        return all(np.array_equal(each, initial[name]) for name, each in self.by_name(values).items())

    def surface(self, values: Sequence[float]) -> np.ndarray:
        """Control points of the design surface at values of the sliders (m), shape (n_surface, 3)."""
        mesh = self.shape.parametrization.mesh
        return self.shape.parametrization.apply(mesh.points[mesh.surface_ids], self.by_name(values))

    def text(self, values: Sequence[float], folder: Path) -> str:
        """The study as it is written, but starting from values of the sliders; for a file in a folder."""
        study, now = self.shape.study, self.by_name(values)
        changed = [name for name, each in now.items() if not np.array_equal(each, self.start[name])]
        if given := [name for name in changed if name in study.evened]:
            raise InputError(
                f"{study.source}: 'even_pressures' of [driver] names '{given[0]}', so that it has no start"
            )
        document: Any = tomlkit.parse(study.source.read_text(encoding="utf-8"))
        for (*path, key), file in study.inputs.items():
            if isinstance(reduce(getitem, path, document), str):  # one file, in place of a list
                key = path.pop()
            reduce(getitem, path, document)[key] = _relative(file, folder)
        for name in changed:
            numbers = now[name].tolist()
            document["variables"][name]["start"] = numbers[0] if len(numbers) == 1 else numbers
        return tomlkit.dumps(document)


def _spread(given: Any, n: int) -> np.ndarray:
    """One number for all, or one for each of n, as an array."""
    return np.array(np.broadcast_to(np.asarray(given, dtype=float), n))


def _relative(file: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    except ValueError:  # on another drive of Windows
        return file.resolve().as_posix()
