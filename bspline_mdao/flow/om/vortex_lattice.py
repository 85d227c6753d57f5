"""OpenAeroStruct's vortex lattice on the camber surface of a regenerated wing, as OpenMDAO groups, and its wake forces.

`VortexLattice` consists of `LatticeStates`, the circulations, and `WakeForces`, lift and drag from the wake.

Theory: ``docs/theory/vortex_lattice.rst``.
"""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om
from openmdao.jacobians.jacobian import Jacobian
from openmdao.vectors.vector import Vector

from ...base.extras import library
from ...core.om.component import SMOOTH_STEP, fails_together
from ...core.om.model_option import Copied
from ..loads.induced_drag import Wake
from .mach_range import MachWatch
from .outputs import declaration

STREAM = [("v", "velocity"), ("rho", "density")]
"""OpenAeroStruct's names of the stream, and the names here."""

_WING = "wing"
"""Name of the wing in OpenAeroStruct's components."""

_DEFAULTS = {
    "alpha": (2.0, "deg"),
    "Mach_number": (0.0, None),
    "velocity": (100.0, "m/s"),
    "density": (1.225, "kg/m**3"),
    "moment_reference": (np.zeros(3), "m"),
}
"""Values and units of the flight conditions."""


class VortexLattice(Copied, om.Group):
    """Lift, induced drag, moment and span load of a thin wing by OpenAeroStruct's vortex lattice.

    ====================  ======  ====================  ======  ========================================================
    name                  role    shape                 units   meaning
    ====================  ======  ====================  ======  ========================================================
    ``camber_surface``    input   (n_chord, n_span, 3)  m       nodes, see `CamberSurface`: from the leading to the
                                                                trailing edge, from the left tip to the root and on
    ``alpha``             input   (1,)                  deg     angle of attack; 2 by default
    ``Mach_number``       input   (1,)                          Prandtl-Glauert below 1; 0 by default
    ``velocity``          input   (1,)                  m/s     100 by default; coefficients do not depend on it
    ``density``           input   (1,)                  kg/m^3  1.225 by default; as the velocity
    ``moment_reference``  input   (3,)                  m       point that moments are taken about; the origin by
                                                                default
    ``CL``, ``CD``        output  (1,)                          lift and induced drag from the wake far downstream
    ``span_load``         output  (n_span - 1)          m       chord times lift coefficient of every strip
    ``CL_panels``,        output  (1,)                          lift and induced drag from the forces on the bound
    ``CD_panels``                                               vortices, OpenAeroStruct's own
    ``CM``                output  (3,)                          moments, of the same forces
    ``S_ref``             output  (1,)                  m^2     projected area of the whole wing; an input where
                                                                ``reference_area`` is given
    ====================  ======  ====================  ======  ========================================================

    Options
    -------
    n_chord, n_span : int
        Nodes of the lattice.
    symmetry : bool
        Whether the lattice is the left half of a wing that is symmetric about y = 0.
    reference_area : float, optional
        Fixed area of the whole wing (m^2); by default the lattice's.

    Raises
    ------
    InputError
        In ``setup``, if OpenAeroStruct is not installed.

    Notes
    -----
    Optimise with ``CL`` and ``CD``. The forces on the bound vortices omit those on the chordwise ones, which an
    optimiser with free twist at every station exploits: their drag falls far below Munk's minimum.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao.flow import VortexLattice
    >>> problem = om.Problem(VortexLattice(n_chord=2, n_span=5, reference_area=8.0), reports=None)
    >>> _ = problem.setup()
    >>> problem.final_setup()
    >>> sorted(meta["prom_name"] for _, meta in problem.model.list_vars(is_indep_var=None, out_stream=None))[:3]
    ['CD', 'CD_panels', 'CL']
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            n_chord: int,
            n_span: int,
            symmetry: bool = True,
            reference_area: float | None = None,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("n_chord", types=int, lower=2, desc="nodes along the chord")
        self.options.declare("n_span", types=int, lower=2, desc="nodes along the span")
        self.options.declare("symmetry", types=bool, default=True, desc="the lattice is one half of the wing")
        self.options.declare("reference_area", default=None, desc="fixed reference area of the whole wing, m**2")

    @fails_together
    def setup(self) -> None:
        """Add OpenAeroStruct's components and the components of the wake."""
        sizes = {name: self.options[name] for name in ("n_chord", "n_span", "symmetry")}
        surface = lattice_surface(**sizes)
        self.add_subsystem(
            "lattice",
            LatticeStates(**sizes),
            promotes_inputs=["camber_surface", "alpha", "Mach_number", "velocity", "density"],
            promotes_outputs=["circulations", ("S_ref", self._mesh_area)],
        )
        self._add_panel_forces(surface)
        self._add_moment(surface)
        self.add_subsystem("wake", WakeForces(**sizes), promotes=["*"])
        for name, (value, units) in _DEFAULTS.items():
            self.set_input_defaults(name, val=value, units=units)
        self.set_input_defaults("camber_surface", val=surface["mesh"], units="m")
        if self.options["reference_area"] is not None:
            self.set_input_defaults("S_ref", val=self.options["reference_area"], units="m**2")

    @property
    def _mesh_area(self) -> str:
        """Name of the lattice's own area."""
        return "S_ref" if self.options["reference_area"] is None else "S_mesh"

    def _add_panel_forces(self, surface: dict[str, Any]) -> None:
        """Add the path from the forces on the panels to their coefficients."""
        lift_drag = openaerostruct("aerodynamics.lift_drag").LiftDrag(surface=surface)
        self.add_subsystem("forces", lift_drag, promotes_inputs=["alpha"])
        self.add_subsystem(
            "coefficients",
            openaerostruct("aerodynamics.coeffs").Coeffs(),
            promotes_inputs=[*STREAM, "S_ref"],
            promotes_outputs=[("CL1", "CL_panels"), ("CDi", "CD_panels")],
        )
        self.connect("lattice.panel_forces", "forces.sec_forces")
        for name in ("L", "D"):
            self.connect(f"forces.{name}", f"coefficients.{name}")

    def _add_moment(self, surface: dict[str, Any]) -> None:
        """Add the path from the forces on the panels to the coefficients of their moments."""
        areas = [("S_ref_total", "S_ref"), ("wing_S_ref", self._mesh_area)]
        self.add_subsystem(
            "moment",
            openaerostruct("functionals.moment_coefficient").MomentCoefficient(surfaces=[surface]),
            promotes_inputs=[*STREAM, ("cg", "moment_reference"), *areas],
            promotes_outputs=["CM"],
        )
        self.connect("lattice.panel_forces", "moment.wing_sec_forces")
        for name in ("b_pts", "widths", "chords"):
            self.connect(f"lattice.{name}", f"moment.wing_{name}")


class LatticeStates(Copied, om.Group):
    """Circulations and forces of the lattice on a thin wing.

    ====================  ======  ==============================  ======  ==============================================
    name                  role    shape                           units   meaning
    ====================  ======  ==============================  ======  ==============================================
    ``camber_surface``    input   (n_chord, n_span, 3)            m       nodes
    ``alpha``             input   (1,)                            deg     angle of attack
    ``Mach_number``       input   (1,)                                    Prandtl-Glauert below 1
    ``velocity``          input   (1,)                            m/s
    ``density``           input   (1,)                            kg/m^3
    ``circulations``      output  ((n_chord - 1) (n_span - 1))    m^2/s   of the rings, in the Prandtl-Glauert space
    ``panel_forces``      output  (n_chord - 1, n_span - 1, 3)    N       on the bound vortices
    ``S_ref``             output  (1,)                            m^2     projected area of the whole wing
    ``b_pts``,            output                                  m       ends of the bound vortices, widths of the
    ``widths``,                                                           strips along the sweep, chords at the stations
    ``chords``
    ====================  ======  ==============================  ======  ==============================================

    Options
    -------
    n_chord, n_span : int
        Nodes of the lattice.
    symmetry : bool
        Whether the lattice is the left half of a wing that is symmetric about y = 0.

    Raises
    ------
    InputError
        In ``setup``, if OpenAeroStruct is not installed.
    """

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("n_chord", types=int, lower=2, desc="nodes along the chord")
        self.options.declare("n_span", types=int, lower=2, desc="nodes along the span")
        self.options.declare("symmetry", types=bool, default=True, desc="the lattice is one half of the wing")

    @fails_together
    def setup(self) -> None:
        """Add OpenAeroStruct's components."""
        surface = lattice_surface(self.options["n_chord"], self.options["n_span"], self.options["symmetry"])
        self.add_subsystem(
            "panels",
            openaerostruct("aerodynamics.geometry").VLMGeometry(surface=surface),
            promotes_inputs=[("def_mesh", "camber_surface")],
            promotes_outputs=["S_ref", "b_pts", "widths", "chords"],
        )
        self.add_subsystem(
            "lattice",
            openaerostruct("aerodynamics.compressible_states").CompressibleVLMStates(surfaces=[surface]),
            promotes_inputs=[(f"{_WING}_def_mesh", "camber_surface"), *STREAM, "alpha", "Mach_number"],
            promotes_outputs=["circulations", (f"{_WING}_sec_forces", "panel_forces")],
        )
        self.add_subsystem("mach", MachWatch(), promotes_inputs=["Mach_number"])
        self.connect("panels.normals", f"lattice.{_WING}_normals")
        self.set_input_defaults("camber_surface", val=surface["mesh"], units="m")


class WakeForces(Copied, om.ExplicitComponent):
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
    ``span_load``       output  (n_span - 1)                   m       lift per length and dynamic pressure: chord
                                                                       times lift coefficient of every strip
    ==================  ======  =============================  ======  =================================================

    Options
    -------
    n_chord, n_span : int
        Nodes of the lattice.
    symmetry : bool
        Whether the lattice is one half of the wing.
    """

    is_linear = False
    """Whether the outputs depend linearly on the inputs."""

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("n_chord", types=int, desc="nodes along the chord")
        self.options.declare("n_span", types=int, desc="nodes along the span")
        self.options.declare("symmetry", types=bool, default=True, desc="the lattice is one half of the wing")

    @fails_together
    def setup(self) -> None:
        """Declare the variables."""
        n_chord, n_span = self.options["n_chord"], self.options["n_span"]
        self.add_input("camber_surface", shape=(n_chord, n_span, 3), units="m")
        self.add_input("circulations", shape=(n_chord - 1) * (n_span - 1), units="m**2/s")
        self.add_input("alpha", units="deg")
        self.add_input("Mach_number", val=0.0)
        self.add_input("velocity", units="m/s")
        self.add_input("S_ref", units="m**2")
        for name, functional in (("CL", "CL"), ("CD", "CD_induced"), ("span_load", "span_load")):
            self.add_output(name, **declaration(functional, {"strips": n_span - 1}))

    @fails_together
    def setup_partials(self) -> None:
        """Declare nonzero partials: the last row of nodes and of rings."""
        n_chord, n_span = self.options["n_chord"], self.options["n_span"]
        nodes = np.arange((n_chord - 1) * n_span * 3, n_chord * n_span * 3)
        strips = np.arange(n_span - 1)
        rings = (n_chord - 2) * (n_span - 1) + strips
        self.declare_partials("CL", "camber_surface", rows=np.zeros_like(nodes), cols=nodes)
        self.declare_partials("CD", "camber_surface", rows=np.zeros_like(nodes), cols=nodes)
        self.declare_partials(["CL", "CD"], "circulations", rows=np.zeros_like(rings), cols=rings)
        self.declare_partials("span_load", "circulations", rows=strips, cols=rings)
        self.declare_partials("span_load", ["Mach_number", "velocity"], rows=strips, cols=np.zeros_like(strips))
        self.declare_partials("CD", "alpha")  # the lift is projected across the span only, which alpha does not change
        self.declare_partials(["CL", "CD"], ["Mach_number", "velocity", "S_ref"])
        self.set_check_partial_options("*", method="fd", form="central", step=SMOOTH_STEP)

    @fails_together
    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Sum lift and drag of the strips."""
        wake, speed, area = self._wake(inputs), inputs["velocity"], inputs["S_ref"]
        outputs["CL"] = 2.0 * wake.lift / (speed * area)
        outputs["CD"] = 2.0 * wake.drag / (speed**2 * area)
        outputs["span_load"] = 2.0 * wake.circulations / speed

    @fails_together
    def compute_partials(self, inputs: Vector, partials: Jacobian) -> None:
        """Differentiate the sums over the strips."""
        wake, speed, area = self._wake(inputs), inputs["velocity"], inputs["S_ref"]
        drag_factor = 2.0 / (speed**2 * area)
        self._force_partials(inputs, partials, "CL", 1, wake.lift, wake.lift_gradients(), 2.0 / (speed * area))
        self._force_partials(inputs, partials, "CD", 2, wake.drag, wake.drag_gradients(), drag_factor)
        partials["CD", "alpha"] = drag_factor * self._alpha_bar(inputs, wake.drag_gradients()[0])
        partials["span_load", "circulations"] = 2.0 * self._circulation_per_ring(inputs) / speed
        partials["span_load", "Mach_number"] = 2.0 * wake.circulations / speed * self._relative_mach_slope(inputs)
        partials["span_load", "velocity"] = -2.0 * wake.circulations / speed**2

    def _force_partials(
        self,
        inputs: Vector,
        partials: Jacobian,
        name: str,
        power: int,
        force: float,
        bars: tuple[np.ndarray, np.ndarray],
        factor: np.ndarray,
    ) -> None:
        """Differentiate a coefficient whose force scales with a power of the circulations, and its factor."""
        points_bar, circulations_bar = bars
        partials[name, "camber_surface"] = factor * (points_bar @ self._turn(inputs)).ravel()
        partials[name, "circulations"] = factor * self._circulation_per_ring(inputs) * circulations_bar
        partials[name, "Mach_number"] = power * factor * force * self._relative_mach_slope(inputs)
        partials[name, "velocity"] = -power * factor * force / inputs["velocity"]
        partials[name, "S_ref"] = -factor * force / inputs["S_ref"]

    def _wake(self, inputs: Vector) -> Wake:
        """Trace of the last row in the plane across the wind, and the circulations in physical space."""
        trailing, turn = inputs["camber_surface"][-1], self._turn(inputs)
        rings = inputs["circulations"][-(self.options["n_span"] - 1) :]
        return Wake(trailing @ turn.T, self._circulation_per_ring(inputs) * rings, self.options["symmetry"])

    @staticmethod
    def _circulation_per_ring(inputs: Vector) -> np.ndarray:
        """Circulation in physical space divided by a ring's, which is negative if it lifts."""
        return -1.0 / (1.0 - inputs["Mach_number"] ** 2)

    @staticmethod
    def _relative_mach_slope(inputs: Vector) -> np.ndarray:
        """Relative change of the circulations with the Mach number at fixed rings."""
        return 2.0 * inputs["Mach_number"] / (1.0 - inputs["Mach_number"] ** 2)

    @staticmethod
    def _alpha_bar(inputs: Vector, points_bar: np.ndarray) -> np.ndarray:
        """Derivative with respect to alpha (1/deg), from derivatives with respect to the trace."""
        alpha, trailing = np.radians(inputs["alpha"][0]), inputs["camber_surface"][-1]
        return np.radians(points_bar[:, 1] @ -(np.cos(alpha) * trailing[:, 0] + np.sin(alpha) * trailing[:, 2]))

    @staticmethod
    def _turn(inputs: Vector) -> np.ndarray:
        """Rows are the axes of the Trefftz plane, shape (2, 3)."""
        alpha = inputs["alpha"][0] * np.pi / 180.0
        zero = 0.0 * alpha
        return np.array([[zero, zero + 1.0, zero], [-np.sin(alpha), zero, np.cos(alpha)]])


def openaerostruct(module: str) -> ModuleType:
    """Import a module of OpenAeroStruct, which only flow components need."""
    return library(f"openaerostruct.{module}", "the vortex lattice needs OpenAeroStruct", "vlm")


def lattice_surface(
    n_chord: int,  # n_chord, n_span: nodes of the lattice
    n_span: int,
    symmetry: bool = True,  # the lattice is the left half of a symmetric wing
    **settings: Any,  # further entries of the dictionary
) -> dict:
    """Describe a wing to OpenAeroStruct: its components take sizes and the side of the wing from a mesh."""
    mesh = np.zeros((n_chord, n_span, 3))
    mesh[..., 0] = np.linspace(0.0, 1.0, n_chord)[:, None]
    mesh[..., 1] = np.linspace(-1.0, 0.0 if symmetry else 1.0, n_span)
    return {"name": _WING, "symmetry": symmetry, "S_ref_type": "projected", "mesh": mesh, **settings}
