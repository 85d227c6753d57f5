"""Hinge moments about axes that design variables move, as an OpenMDAO component."""

from __future__ import annotations

import numpy as np
import openmdao.api as om
from openmdao.jacobians.jacobian import Jacobian
from openmdao.vectors.vector import Vector

from ...core.om.component import fails_together, finite_points, finite_values
from ..loads.axis_moments import hinge_moment, hinge_moment_rates
from ..loads.hinges import HingeMoment

__all__ = ["MovedHingeMoment"]


class MovedHingeMoment(om.ExplicitComponent):
    """Moment of a control surface about its hinge, wherever the hinge is.

    =================  ======  =====  =====  ======================================================================
    name               role    shape  units  meaning
    =================  ======  =====  =====  ======================================================================
    ``loads_...``      input   (6,)          force (m^2) and moment (m^3) of the control surface, see `EulerForces`
    name of the hinge  input   (6,)   m      both points of its axis, as `GridMovement` gives them
    ``CM_...``         output  (1,)          hinge moment
    =================  ======  =====  =====  ======================================================================

    Options
    -------
    hinge : HingeMoment
        The hinge moment, whose axis is a `Hinge`.
    volume : float
        Reference area times reference chord (m^3).

    Raises
    ------
    om.AnalysisError
        In a run, if an input is not finite.
    """

    is_linear = False
    """Whether the output depends linearly on the inputs."""

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("hinge", types=HingeMoment, recordable=False, desc="the hinge moment")
        self.options.declare("volume", desc="reference area times chord, m^3")

    def setup(self) -> None:
        """Declare the variables."""
        hinge = self.options["hinge"]
        self._names = hinge.loads, hinge.axis.name, hinge.output
        self._origin = hinge.axis.points[0]
        self.add_input(hinge.loads, shape=6)
        self.add_input(hinge.axis.name, val=hinge.axis.points.ravel(), units="m")
        self.add_output(hinge.output, desc="hinge moment")
        self.declare_partials("*", "*")

    @fails_together
    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Take the moment about the axis."""
        outputs[self._names[2]] = hinge_moment(*self._at(inputs)) / self.options["volume"]

    @fails_together
    def compute_partials(self, inputs: Vector, partials: Jacobian) -> None:
        """Differentiate it."""
        loads, axis, output = self._names
        of_loads, of_axis = hinge_moment_rates(*self._at(inputs))
        partials[output, loads] = of_loads / self.options["volume"]
        partials[output, axis] = of_axis.ravel() / self.options["volume"]

    def _at(self, inputs: Vector) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Loads, axis and origin."""
        loads, axis, _ = self._names
        points = finite_points(inputs[axis], axis, self.msginfo)
        return finite_values(inputs[loads], loads, self.msginfo), points, self._origin
