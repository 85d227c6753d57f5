"""Our flow groups under the names and tags of MPhys."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import openmdao.api as om

from ...names import GRID
from ..jacobian import LINEAR_STEP, check_along_directions
from .conventions import ANGLE_OF_ATTACK, COUPLING, INPUT, MACH_NUMBER, RESULT, VOLUME

__all__ = ["FlowGroup"]


class FlowGroup(om.Group):
    """Solve a flow on the volume nodes that MPhys hands over.

    =====================  ======  ==============  =====  =========================================
    name                   role    shape           units  meaning
    =====================  ======  ==============  =====  =========================================
    ``aero_vol_coords``    input   (3 n_nodes)            nodes of the grid (m)
    ``angle_of_attack``    input   (1,)            deg    2 by default
    ``mach_number``        input   (1,)                   0.3 by default
    name of each result    output  the flow's own         coefficients and whatever else was named
    =====================  ======  ==============  =====  =========================================

    Options
    -------
    flow : callable
        Makes the group that solves the flow: of ``grid``, ``alpha`` (deg) and ``Mach_number``.
    n_nodes : int
        Number of nodes of the grid.
    results : dict
        Units of its outputs to hand on, None where there are none, by name.
    """

    def initialize(self):
        """Declare the options."""
        self.options.declare("flow", types=Callable, recordable=False, desc="makes the group that solves the flow")
        self.options.declare("n_nodes", types=int, desc="number of nodes of the grid")
        self.options.declare("results", types=Mapping, desc="units of its outputs to hand on, by name")

    def setup(self):
        """Put the flow between two components that translate."""
        conditions, results = _conditions(3 * self.options["n_nodes"]), _results(self.options["results"])
        self.add_subsystem("conditions", _Renamed(pairs=conditions), promotes_inputs=["*"])
        self.add_subsystem("flow", self.options["flow"]())
        self.add_subsystem("results", _Renamed(pairs=results), promotes_outputs=["*"])
        for pair in conditions:
            self.connect(f"conditions.{pair.target}", f"flow.{pair.target}")
        for pair in results:
            self.connect(f"flow.{pair.target}", f"results.{pair.source}")


@dataclass(frozen=True)
class _Pair:
    """A variable under two names, and how each is declared."""

    source: str
    target: str
    as_input: dict
    as_output: dict


def _conditions(size: int) -> list[_Pair]:
    """Names of MPhys for what a flow group wants."""
    degrees = {"val": 2.0, "units": "deg"}
    return [
        _Pair(VOLUME, GRID, {"shape": size, "tags": COUPLING}, {"shape": size, "units": "m"}),
        _Pair(ANGLE_OF_ATTACK, "alpha", {**degrees, "tags": INPUT}, degrees),
        _Pair(MACH_NUMBER, "Mach_number", {"val": 0.3, "tags": INPUT}, {"val": 0.3}),
    ]


def _results(units: Mapping[str, str | None]) -> list[_Pair]:
    """Outputs of a flow group, which are to keep their names."""
    pairs = []
    for name, unit in units.items():
        source = f"{name}_of_flow"
        as_output = {"copy_shape": source, "units": unit, "tags": RESULT}
        pairs.append(_Pair(source, name, {"shape_by_conn": True, "units": unit}, as_output))
    return pairs


class _Renamed(om.ExplicitComponent):
    """Hand variables on under other names, with the tags by which MPhys promotes them."""

    def initialize(self):
        self.options.declare("pairs", recordable=False)

    def setup(self):
        for pair in self.options["pairs"]:
            self.add_input(pair.source, **pair.as_input)
            self.add_output(pair.target, **pair.as_output)
        check_along_directions(self, LINEAR_STEP)

    def compute(self, inputs, outputs):
        for pair in self.options["pairs"]:
            outputs[pair.target] = inputs[pair.source]

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        for pair in self.options["pairs"]:
            if pair.target in d_outputs and pair.source in d_inputs:
                if mode == "fwd":
                    d_outputs[pair.target] += d_inputs[pair.source]
                else:
                    d_inputs[pair.source] += d_outputs[pair.target]
