"""Variables of groups under the names and tags of MPhys."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import openmdao.api as om
from openmdao.vectors.vector import Vector

from ..check_directions import check_along_directions
from ..component import LINEAR_STEP

__all__ = ["Renamed", "Renaming"]


@dataclass(frozen=True)
class Renaming:
    """A variable under two names, with the declaration of each."""

    source: str
    target: str
    as_input: dict
    as_output: dict


class Renamed(om.ExplicitComponent):
    """Copy variables to other names and shapes, with the tags by which MPhys promotes them."""

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("pairs", types=Sequence, recordable=False, desc="the variables")

    def setup(self) -> None:
        """Declare the variables."""
        for pair in self.options["pairs"]:
            self.add_input(pair.source, **pair.as_input)
            self.add_output(pair.target, **pair.as_output)
        check_along_directions(self, LINEAR_STEP)

    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Copy them."""
        for pair in self.options["pairs"]:
            outputs[pair.target] = inputs[pair.source].reshape(outputs[pair.target].shape)

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose."""
        for pair in self.options["pairs"]:
            if pair.target in d_outputs and pair.source in d_inputs:
                source, target = d_inputs[pair.source], d_outputs[pair.target]
                if mode == "fwd":
                    d_outputs[pair.target] += source.reshape(target.shape)
                else:
                    d_inputs[pair.source] += target.reshape(source.shape)
