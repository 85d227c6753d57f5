"""The circulations of OpenAeroStruct's vortex lattice, as an OpenMDAO group, and access to OpenAeroStruct."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import openmdao.api as om

from ...errors import InputError

_WING = "wing"
"""Name that OpenAeroStruct's components give the wing."""

STREAM = [("v", "velocity"), ("rho", "density")]
"""OpenAeroStruct's names of the stream and ours."""


class LatticeStates(om.Group):
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
        The lattice is the left half of a wing that is symmetric about y = 0.

    Raises
    ------
    InputError
        In ``setup``, if OpenAeroStruct is not there.
    """

    def initialize(self):
        """Declare the options."""
        self.options.declare("n_chord", types=int, lower=2, desc="nodes along the chord")
        self.options.declare("n_span", types=int, lower=2, desc="nodes along the span")
        self.options.declare("symmetry", types=bool, default=True, desc="the lattice is one half of the wing")

    def setup(self):
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
        self.connect("panels.normals", f"lattice.{_WING}_normals")
        self.set_input_defaults("camber_surface", val=surface["mesh"], units="m")


def openaerostruct(module: str):
    """Import a module of OpenAeroStruct, which is wanted by flow components alone.

    Raises
    ------
    InputError
        If it is not there.
    """
    try:
        return import_module(f"openaerostruct.{module}")
    except ImportError as error:
        raise InputError(
            f'the vortex lattice needs OpenAeroStruct: pip install "bspline_mdao[vlm]" ({error})'
        ) from error


def lattice_surface(n_chord: int, n_span: int, symmetry: bool = True, **settings) -> dict:
    """Describe a wing to OpenAeroStruct: its components take sizes and the side of the wing from a mesh.

    Parameters
    ----------
    n_chord, n_span : int
        Nodes of the lattice.
    symmetry : bool
        The lattice is the left half of a symmetric wing.
    **settings
        Further entries of the dictionary.
    """
    mesh = np.zeros((n_chord, n_span, 3))
    mesh[..., 0] = np.linspace(0.0, 1.0, n_chord)[:, None]
    mesh[..., 1] = np.linspace(-1.0, 0.0 if symmetry else 1.0, n_span)
    return {"name": _WING, "symmetry": symmetry, "S_ref_type": "projected", "mesh": mesh, **settings}
