"""Steps one after the other, whose values have names: their values at arrays, and products with the derivative there.

A step is decided once: names and shapes of what it takes and gives. ``place = step.at(values)`` has its values at some
arrays, and both products with its derivative there. A chain is a step of steps: forward products go through them in
their order, transposed ones in the reverse order. What frameworks differentiate is a chain, and crosses to us once.

For users: ``docs/howto/jax_and_pytorch.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...base.display import OneLine
from ...errors import InputError

__all__ = ["Arrays", "Chain", "Place", "Shapes", "Step"]

Arrays = Mapping[str, np.ndarray]
"""Arrays by the names of values."""

Shapes = Mapping[str, tuple[int, ...]]
"""Their shapes."""


class Place(Protocol):
    """A step at some arrays."""

    @property
    def values(self) -> Arrays:
        """What the step gives, by names."""

    def jvp(self, changes: Arrays) -> Arrays:
        """Changes of all that it gives, with those of all that it takes."""

    def vjp(self, bars: Arrays) -> Arrays:
        """Transpose of `jvp`."""


class Step(Protocol):
    """A function of arrays."""

    @property
    def inputs(self) -> Shapes:
        """Names and shapes of what it takes."""

    @property
    def outputs(self) -> Shapes:
        """Names and shapes of what it gives."""

    def at(self, values: Arrays) -> Place:
        """Take values; `MovementError` where there is nothing sensible to give."""


@dataclass(frozen=True, eq=False)
class Chain(OneLine):
    """Steps, each of which takes what the chain does or what steps before it give."""

    inputs: Shapes  # what the chain takes
    steps: Sequence[Step]
    given: Sequence[str]  # names of what it gives

    @property
    def outputs(self) -> Shapes:
        """Names and shapes of what it gives."""
        shapes = {name: shape for step in self.steps for name, shape in step.outputs.items()}
        return {name: shapes[name] for name in self.given}

    def at(self, values: Arrays) -> ChainPlace:
        """Take one step after the other."""
        found = {}
        for name, shape in self.inputs.items():
            if name not in values or np.shape(values[name]) != shape:
                what = f"of shape {np.shape(values[name])}" if name in values else "missing"
                raise InputError(f"'{name}' is {what}; give shape {shape}")
            found[name] = np.asarray(values[name], dtype=float, order="C")
        places = []
        for step in self.steps:
            places.append(step.at({name: found[name] for name in step.inputs}))
            found |= places[-1].values
        return ChainPlace(self, tuple(places), {name: np.asarray(found[name]) for name in self.given})


@dataclass(frozen=True, eq=False)
class ChainPlace(OneLine):
    """A chain at some arrays."""

    of: Chain
    places: Sequence[Place]  # of every step
    values: Arrays

    def jvp(self, changes: Arrays) -> Arrays:
        """Changes of all that the chain gives."""
        found = dict(changes)
        for step, place in zip(self.of.steps, self.places):
            found |= place.jvp({name: found[name] for name in step.inputs})
        return {name: found[name] for name in self.of.given}

    def vjp(self, bars: Arrays) -> Arrays:
        """Transpose of `jvp`: what several steps take collects what comes back from each."""
        found = dict(bars)
        for step, place in zip(reversed(self.of.steps), reversed(self.places)):
            back = {name: found.get(name, np.zeros(shape)) for name, shape in step.outputs.items()}
            for name, bar in place.vjp(back).items():
                found[name] = found[name] + bar if name in found else bar
        return {name: found.get(name, np.zeros(shape)) for name, shape in self.of.inputs.items()}
