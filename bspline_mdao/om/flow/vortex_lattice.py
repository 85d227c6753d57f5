"""OpenAeroStruct's vortex lattice on the camber surface of a regenerated wing, as an OpenMDAO group."""

from __future__ import annotations

import numpy as np
import openmdao.api as om

from .lattice_states import STREAM, LatticeStates, lattice_surface, openaerostruct
from .wake_forces import WakeForces


class VortexLattice(om.Group):
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
        The lattice is the left half of a wing that is symmetric about y = 0.
    reference_area : float, optional
        Of the whole wing (m^2), fixed; that of the lattice by default.

    Raises
    ------
    InputError
        In ``setup``, if OpenAeroStruct is not there.

    Notes
    -----
    Optimise with ``CL`` and ``CD``. The forces on the bound vortices leave out those on the chordwise ones, which an
    optimiser with free twist at every station learns to make use of: their drag falls far below Munk's least one.
    """

    def initialize(self):
        """Declare the options."""
        self.options.declare("n_chord", types=int, lower=2, desc="nodes along the chord")
        self.options.declare("n_span", types=int, lower=2, desc="nodes along the span")
        self.options.declare("symmetry", types=bool, default=True, desc="the lattice is one half of the wing")
        self.options.declare("reference_area", default=None, desc="fixed reference area of the whole wing, m**2")

    def setup(self):
        """Add OpenAeroStruct's components and those of the wake."""
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

    def _add_panel_forces(self, surface):
        """From the forces on the panels to their coefficients."""
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

    def _add_moment(self, surface):
        """From the forces on the panels to the coefficients of their moments."""
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


_DEFAULTS = {
    "alpha": (2.0, "deg"),
    "Mach_number": (0.0, None),
    "velocity": (100.0, "m/s"),
    "density": (1.225, "kg/m**3"),
    "moment_reference": (np.zeros(3), "m"),
}
"""Values and units of the inputs of the flight."""
