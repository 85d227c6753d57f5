"""Lift and induced drag from the wake of a vortex lattice, as an OpenMDAO component."""

from __future__ import annotations

import numpy as np
import openmdao.api as om

from ...flow.wake import Wake
from ..jacobian import SMOOTH_STEP


class WakeForces(om.ExplicitComponent):
    """Coefficients of lift and induced drag, and the span load, from the circulations of a vortex lattice.

    ==================  ======  =============================  ======  =================================================
    name                role    shape                          units   meaning
    ==================  ======  =============================  ======  =================================================
    ``camber_surface``  input   (n_chord, n_span, 3)           m       the lattice; the wake leaves its last row
    ``circulations``    input   ((n_chord - 1) (n_span - 1))   m^2/s   of the rings, in the Prandtl-Glauert space
    ``alpha``           input   (1,)                           deg     angle of attack
    ``Mach_number``     input   (1,)
    ``velocity``        input   (1,)                           m/s
    ``S_ref``           input   (1,)                           m^2     reference area of the whole wing
    ``CL``, ``CD``      output  (1,)                                   lift, induced drag
    ``span_load``       output  (n_span - 1)                   m       lift per length by the dynamic pressure: chord
                                                                       times lift coefficient of every strip
    ==================  ======  =============================  ======  =================================================

    Options
    -------
    n_chord, n_span : int
        Nodes of the lattice.
    symmetry : bool
        The lattice is one half of the wing.
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    def initialize(self):
        """Declare the options."""
        self.options.declare("n_chord", types=int, desc="nodes along the chord")
        self.options.declare("n_span", types=int, desc="nodes along the span")
        self.options.declare("symmetry", types=bool, default=True, desc="the lattice is one half of the wing")

    def setup(self):
        """Declare the variables."""
        n_chord, n_span = self.options["n_chord"], self.options["n_span"]
        self.add_input("camber_surface", shape=(n_chord, n_span, 3), units="m")
        self.add_input("circulations", shape=(n_chord - 1) * (n_span - 1), units="m**2/s")
        self.add_input("alpha", units="deg")
        self.add_input("Mach_number", val=0.0)
        self.add_input("velocity", units="m/s")
        self.add_input("S_ref", units="m**2")
        self.add_output("CL")
        self.add_output("CD")
        self.add_output("span_load", shape=n_span - 1, units="m")

    def setup_partials(self):
        """Declare what may differ from zero: the last row of nodes and of rings."""
        n_chord, n_span = self.options["n_chord"], self.options["n_span"]
        nodes = np.arange((n_chord - 1) * n_span * 3, n_chord * n_span * 3)
        strips = np.arange(n_span - 1)
        rings = (n_chord - 2) * (n_span - 1) + strips
        self.declare_partials("CL", "camber_surface", rows=np.zeros_like(nodes), cols=nodes)
        self.declare_partials("CD", "camber_surface", rows=np.zeros_like(nodes), cols=nodes)
        self.declare_partials(["CL", "CD"], "circulations", rows=np.zeros_like(rings), cols=rings)
        self.declare_partials("span_load", "circulations", rows=strips, cols=rings)
        self.declare_partials("span_load", ["Mach_number", "velocity"], rows=strips, cols=np.zeros_like(strips))
        self.declare_partials("CD", "alpha")  # the lift is seen across the span alone, which alpha does not change
        self.declare_partials(["CL", "CD"], ["Mach_number", "velocity", "S_ref"])
        self.set_check_partial_options("*", method="fd", form="central", step=SMOOTH_STEP)

    def compute(self, inputs, outputs):
        """Sum the strips."""
        wake, speed, area = self._wake(inputs), inputs["velocity"], inputs["S_ref"]
        outputs["CL"] = 2.0 * wake.lift / (speed * area)
        outputs["CD"] = 2.0 * wake.drag / (speed**2 * area)
        outputs["span_load"] = 2.0 * wake.circulations / speed

    def compute_partials(self, inputs, partials):
        """Differentiate the sums."""
        wake, speed, area = self._wake(inputs), inputs["velocity"], inputs["S_ref"]
        drag_factor = 2.0 / (speed**2 * area)
        self._force_partials(inputs, partials, "CL", 1, wake.lift, wake.lift_gradients(), 2.0 / (speed * area))
        self._force_partials(inputs, partials, "CD", 2, wake.drag, wake.drag_gradients(), drag_factor)
        partials["CD", "alpha"] = drag_factor * self._alpha_bar(inputs, wake.drag_gradients()[0])
        partials["span_load", "circulations"] = 2.0 * self._by_ring(inputs) / speed
        partials["span_load", "Mach_number"] = 2.0 * wake.circulations / speed * self._by_mach(inputs)
        partials["span_load", "velocity"] = -2.0 * wake.circulations / speed**2

    def _force_partials(self, inputs, partials, name, power, force, bars, factor):
        """Differentiate a coefficient whose force goes with a power of the circulations, and its factor."""
        points_bar, circulations_bar = bars
        partials[name, "camber_surface"] = factor * (points_bar @ self._turn(inputs)).ravel()
        partials[name, "circulations"] = factor * self._by_ring(inputs) * circulations_bar
        partials[name, "Mach_number"] = power * factor * force * self._by_mach(inputs)
        partials[name, "velocity"] = -power * factor * force / inputs["velocity"]
        partials[name, "S_ref"] = -factor * force / inputs["S_ref"]

    def _wake(self, inputs) -> Wake:
        """Trace of the last row in the plane across the wind, and the circulations in physical space."""
        trailing, turn = inputs["camber_surface"][-1], self._turn(inputs)
        rings = inputs["circulations"][-(self.options["n_span"] - 1) :]
        return Wake(trailing @ turn.T, self._by_ring(inputs) * rings, self.options["symmetry"])

    @staticmethod
    def _by_ring(inputs):
        """Circulation in physical space by that of a ring, which is negative where it lifts."""
        return -1.0 / (1.0 - inputs["Mach_number"] ** 2)

    @staticmethod
    def _by_mach(inputs):
        """Relative change of the circulations with the Mach number at given rings."""
        return 2.0 * inputs["Mach_number"] / (1.0 - inputs["Mach_number"] ** 2)

    @staticmethod
    def _alpha_bar(inputs, points_bar):
        """Derivative in alpha (1/deg) of the derivatives in the trace."""
        alpha, trailing = np.radians(inputs["alpha"][0]), inputs["camber_surface"][-1]
        return np.radians(points_bar[:, 1] @ -(np.cos(alpha) * trailing[:, 0] + np.sin(alpha) * trailing[:, 2]))

    @staticmethod
    def _turn(inputs) -> np.ndarray:
        """Rows are the axes of the Trefftz plane, shape (2, 3)."""
        alpha = inputs["alpha"][0] * np.pi / 180.0
        zero = 0.0 * alpha
        return np.array([[zero, zero + 1.0, zero], [-np.sin(alpha), zero, np.cos(alpha)]])
