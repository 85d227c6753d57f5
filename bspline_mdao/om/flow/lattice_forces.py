"""Coefficients from the forces on the panels of a vortex lattice, as an OpenMDAO component."""

from __future__ import annotations

import numpy as np
import openmdao.api as om
from scipy.sparse import csr_array, diags_array, eye_array, kron

from ...flow.force_coefficients import ForceCoefficients
from ...flow.induced_drag import InducedDrag
from ...flow.span_strips import SpanStrips
from ...flow.stream import RADIAN
from ...flow.wing_coefficients import WingCoefficients
from ...measures.camber_surface import CamberSurface
from ..jacobian import SMOOTH_STEP, add_bar, check_along_directions, difference_step, direction_in
from .references import REFERENCES, declare_references


class LatticeForces(om.ExplicitComponent):
    """Lift, drag, moments and span load of the forces on the panels.

    ==================  ======  ============================  =====  ===================================================
    name                role    shape                         units  meaning
    ==================  ======  ============================  =====  ===================================================
    ``panel_forces``    input   (n_chord - 1, n_span - 1, 3)  N      at a dynamic pressure of 1 Pa
    ``camber_surface``  input   (n_chord, n_span, 3)          m      the lattice
    ``alpha``           input   (1,)                          deg    angle of attack
    ``CL``, ``CD``      output  (1,)                                 lift and drag
    ``CM``              output  (3,)                                 moments about x, y and z of the grid
    ``CD_induced``      output  (1,)                                 induced drag from the wake, see `InducedDrag`
    ``span_load``       output  (n_span - 1)                  m      lift per length by the dynamic pressure
    ==================  ======  ============================  =====  ===================================================

    Options
    -------
    camber : CamberSurface
        The lattice on the baseline.
    reference_area, reference_chord : float
        Of the half wing (m^2), and for moments (m).
    moment_reference : array_like, shape (3,)
        Point that moments are taken about, in the axes of the grid (m).
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    def initialize(self):
        """Declare the options."""
        self.options.declare("camber", types=CamberSurface, recordable=False, desc="the lattice on the baseline")
        declare_references(self.options)

    def setup(self):
        """Declare the variables."""
        camber = self.options["camber"]
        n_chord, n_span, _ = camber.shape
        nodes = camber.evaluate(camber.surface.points).reshape(camber.shape)
        check_along_directions(self, SMOOTH_STEP, is_complex=True)
        check_along_directions(self, difference_step([nodes]), "camber_surface", is_complex=True)
        self.add_input("panel_forces", shape=(n_chord - 1, n_span - 1, 3), units="N")
        self.add_input("camber_surface", val=nodes, units="m")
        self.add_input("alpha", units="deg")
        for name in ("CL", "CD", "CD_induced"):
            self.add_output(name)
        self.add_output("CM", shape=3)
        self.add_output("span_load", shape=n_span - 1, units="m")
        self._wing = self._coefficients()

    def compute(self, inputs, outputs):
        """Sum the forces."""
        for name, value in self._wing.evaluate(*self._arguments(inputs)).items():
            outputs[name] = value

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        """Apply the Jacobian or its transpose."""
        if mode == "fwd":
            self._forward(inputs, d_inputs, d_outputs)
        else:
            self._reverse(inputs, d_inputs, d_outputs)

    def _forward(self, inputs, d_inputs, d_outputs):
        forces, nodes = (direction_in(d_inputs, inputs, name) @ self._axes for name in _VECTORS)
        d_alpha = RADIAN * d_inputs["alpha"].item() if "alpha" in d_inputs else 0.0
        found = self._wing.jvp(*self._arguments(inputs), forces, nodes, d_alpha)
        for name in d_outputs:
            d_outputs[name] += found[name]

    def _reverse(self, inputs, d_inputs, d_outputs):
        bars = {name: d_outputs[name] for name in d_outputs}
        *vector_bars, alpha_bar = self._wing.vjp(*self._arguments(inputs), bars)
        for name, bar in zip(_VECTORS, vector_bars):
            add_bar(d_inputs, name, bar @ self._axes.T)
        if "alpha" in d_inputs:
            d_inputs["alpha"] += RADIAN * alpha_bar

    @property
    def _axes(self) -> np.ndarray:
        return self.options["camber"].axes

    def _arguments(self, inputs):
        """Forces, nodes and angle (rad), in the axes of the grid."""
        forces, nodes = (inputs[name].reshape(-1, 3) @ self._axes for name in _VECTORS)
        return forces, nodes, RADIAN * inputs["alpha"][0]

    def _coefficients(self) -> WingCoefficients:
        """What is made of the forces."""
        shape, references = self.options["camber"].shape, (self.options[name] for name in REFERENCES)
        induced = InducedDrag.of_vortices(_strips(shape, self._axes))
        return WingCoefficients(ForceCoefficients(_bound(shape), self._axes, *references), induced)


_VECTORS = ("panel_forces", "camber_surface")
"""Inputs that are vectors."""


def _strips(shape: tuple[int, int, int], axes: np.ndarray) -> SpanStrips:
    """Rows of panels along the chord, from the tip, and the last row of nodes."""
    n_chord, n_span, _ = shape
    shares = kron(np.ones((1, n_chord - 1)), eye_array(n_span - 1), format="csr")
    trailing = eye_array(n_span, n_chord * n_span, k=(n_chord - 1) * n_span, format="csr")
    return SpanStrips(csr_array(shares), csr_array(trailing), axes, is_symmetric=True)


def _bound(shape: tuple[int, int, int]) -> csr_array:
    """Share of every node in the middles of the bound vortices, at a quarter of the chord of every panel."""
    along, across = (
        diags_array([first, second], offsets=[0, 1], shape=(n - 1, n))
        for n, first, second in ((shape[0], 0.75, 0.25), (shape[1], 0.5, 0.5))
    )
    return csr_array(kron(along, across, format="csr"))
