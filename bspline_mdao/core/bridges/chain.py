"""Chained steps with named values: their values at given arrays, and products with the derivative there.

The names and shapes of a step's inputs and outputs are fixed. ``place = step.at(values)`` has its values at given
arrays, and both products with its derivative there. A chain is a step of steps: forward products go through them in
order, transposed ones in reverse order. Frameworks differentiate a chain, with one call across the bridge.

The first steps, up to the movement of the control mesh, are the *lead* of a chain: for a batch they are done together,
with one pass over a factor for all. The *rest*, whose arrays are as long as the grid, follows point by point.

For users: ``docs/howto/jax_and_pytorch.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ...base.display import OneLine
from ...errors import InputError

__all__ = ["Arrays", "Chain", "ChainPlace", "Place", "Shapes", "Step", "Together"]

Arrays = Mapping[str, np.ndarray]
"""Arrays by the names of values."""

Shapes = Mapping[str, tuple[int, ...]]
"""Their shapes."""


class Place(Protocol):
    """A step at some arrays."""

    @property
    def values(self) -> Arrays:
        """Outputs of the step by name."""

    def jvp(self, changes: Arrays) -> Arrays:
        """Changes of all outputs from changes of all inputs."""

    def vjp(self, bars: Arrays) -> Arrays:
        """Transpose of `jvp`."""


class Step(Protocol):
    """A function of arrays."""

    @property
    def inputs(self) -> Shapes:
        """Names and shapes of its inputs."""

    @property
    def outputs(self) -> Shapes:
        """Names and shapes of its outputs."""

    def at(self, values: Arrays) -> Place:
        """Evaluate at values; `MovementError` if that fails."""


class Together(Step, Protocol):
    """A step that can treat several points at once."""

    @property
    def n_together(self) -> int:
        """Number of points for which that is worth the memory."""

    def at_all(self, values: Sequence[Arrays]) -> list[Place]:
        """Evaluate at several values, like `at` for each."""

    def jvps(self, places: Sequence[Place], changes: Sequence[Arrays]) -> list[Arrays]:
        """Products at places, one of which may serve several."""

    def vjps(self, places: Sequence[Place], bars: Sequence[Arrays]) -> list[Arrays]:
        """Transposes of `jvps`."""


@dataclass(frozen=True, eq=False)
class Chain(OneLine):
    """Steps that each take inputs of the chain or outputs of earlier steps."""

    inputs: Shapes  # inputs of the chain
    steps: Sequence[Step]
    given: Sequence[str]  # names of its outputs

    @property
    def outputs(self) -> Shapes:
        """Names and shapes of its outputs."""
        shapes = {name: shape for step in self.steps for name, shape in step.outputs.items()}
        return {name: shapes[name] for name in self.given}

    @property
    def n_lead(self) -> int:
        """Number of steps of the lead."""
        return max((n for n, step in enumerate(self.steps, start=1) if hasattr(step, "at_all")), default=0)

    @property
    def n_together(self) -> int:
        """Number of batch members whose lead is done together."""
        together: list[Any] = [step for step in self.steps if hasattr(step, "at_all")]
        return min((step.n_together for step in together), default=1)

    def at(self, values: Arrays) -> ChainPlace:
        """Evaluate one step after the other."""
        return self.begun([values])[0].finished()

    def begun(self, batch: Sequence[Arrays]) -> list[ChainPlace]:
        """Evaluate the lead for all values of a batch together."""
        found: list[dict] = [{} for _ in batch]
        for values, of in zip(batch, found):
            for name, shape in self.inputs.items():
                if name not in values or np.shape(values[name]) != shape:
                    what = f"of shape {np.shape(values[name])}" if name in values else "missing"
                    raise InputError(f"'{name}' is {what}; give shape {shape}")
                of[name] = np.asarray(values[name], dtype=float, order="C")
        places: list[list[Place]] = [[] for _ in batch]
        for step in self.steps[: self.n_lead]:
            for place, of, mine in zip(_at_all(step, [_part(of, step.inputs) for of in found]), found, places):
                mine.append(place)
                of |= place.values
        return [ChainPlace(self, tuple(mine), of) for mine, of in zip(places, found)]

    def lead_jvps(self, places: Sequence[ChainPlace], changes: Sequence[Arrays]) -> list[Arrays]:
        """Changes of all inputs and outputs of the lead, at the places of a batch together."""
        found = [dict(change) for change in changes]
        for n, step in enumerate(self.steps[: self.n_lead]):
            at = [place.places[n] for place in places]
            for of, change in zip(found, _products(step, "jvp", at, [_part(of, step.inputs) for of in found])):
                of |= change
        return list(found)

    def lead_vjps(self, places: Sequence[ChainPlace], bars: Sequence[Arrays]) -> list[Arrays]:
        """Transpose of `lead_jvps`, for all inputs of the chain."""
        found = [dict(bar) for bar in bars]
        for n in reversed(range(self.n_lead)):
            step, at = self.steps[n], [place.places[n] for place in places]
            back = _products(step, "vjp", at, [_bars_of(of, step.outputs) for of in found])
            for of, bar in zip(found, back):
                _collect(of, bar)
        return [_bars_of(of, self.inputs) for of in found]


@dataclass(frozen=True, eq=False)
class ChainPlace(OneLine):
    """A chain at given arrays, after its lead or after all steps."""

    of: Chain
    places: Sequence[Place]  # of the steps done
    found: Arrays  # all inputs and outputs so far

    def finished(self) -> ChainPlace:
        """The same place after all steps."""
        places, found = list(self.places), dict(self.found)
        for step in self.of.steps[len(places) :]:
            places.append(step.at(_part(found, step.inputs)))
            found |= places[-1].values
        return ChainPlace(self.of, tuple(places), found)

    @property
    def values(self) -> Arrays:
        """Outputs of the chain by name."""
        return {name: np.asarray(self.found[name]) for name in self.of.given}

    def jvp(self, changes: Arrays) -> Arrays:
        """Changes of all outputs of the chain."""
        return self.rest_jvp(self.of.lead_jvps([self], [changes])[0])

    def vjp(self, bars: Arrays) -> Arrays:
        """Transpose of `jvp`: cotangents of an input used by several steps are summed."""
        return self.of.lead_vjps([self], [self.rest_vjp(bars)])[0]

    def rest_jvp(self, changes: Arrays) -> Arrays:
        """Changes of all outputs of the chain from changes of its lead's inputs and outputs."""
        found = dict(changes)
        for step, place in self._rest:
            found |= place.jvp(_part(found, step.inputs))
        return _part(found, self.of.given)

    def rest_vjp(self, bars: Arrays) -> Arrays:
        """Transpose of `rest_jvp`."""
        found = dict(bars)
        for step, place in reversed(self._rest):
            _collect(found, place.vjp(_bars_of(found, step.outputs)))
        return found

    @property
    def _rest(self) -> list[tuple[Step, Place]]:
        return list(zip(self.of.steps, self.places))[self.of.n_lead :]


def _part(arrays: Arrays, names: Iterable[str]) -> dict[str, np.ndarray]:
    return {name: arrays[name] for name in names}


def _bars_of(found: Arrays, shapes: Shapes) -> dict[str, np.ndarray]:
    """Cotangents of some arrays; zero if none came back."""
    return {name: found.get(name, np.zeros(shape)) for name, shape in shapes.items()}


def _collect(found: dict[str, np.ndarray], bars: Arrays) -> None:
    """Add cotangents to the ones collected so far."""
    for name, bar in bars.items():
        found[name] = found[name] + bar if name in found else bar


def _at_all(step: Any, values: Sequence[Arrays]) -> list[Place]:
    """Places of a step at several values."""
    return step.at_all(values) if hasattr(step, "at_all") else [step.at(each) for each in values]


def _products(step: Any, name: str, places: Sequence[Place], along: Sequence[Arrays]) -> list[Arrays]:
    """Products of a step at several places."""
    if hasattr(step, "at_all"):
        return getattr(step, f"{name}s")(places, along)
    return [getattr(place, name)(each) for place, each in zip(places, along)]
