"""OpenAeroStruct's vortex lattice and tubular spar on the camber surface of a wing, as an OpenMDAO group.

Theory: ``docs/theory/vortex_lattice.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om

from ...base.display import OneLine
from ...core.om.component import fails_together
from ...core.om.model_option import Copied
from .vortex_lattice import STREAM, lattice_surface, openaerostruct


@dataclass(frozen=True)
class Spar(OneLine):
    """Tubular spar of a wing: material, place in the chord, and wall thickness.

    Parameters
    ----------
    thickness : tuple of float
        Wall thickness at the control points of a B-spline, from the tip to the root (m): the start of an optimisation.
    youngs_modulus, shear_modulus, allowable_stress : float
        Material properties (Pa).
    density : float
        Density of the material (kg/m^3).
    origin : float
        Its position, as a fraction of the chord.
    weight_ratio : float
        Mass of the wing's structure relative to the spar.

    Examples
    --------
    >>> from bspline_mdao.flow import Spar
    >>> Spar((0.003, 0.004, 0.005)).thickness[-1]  # at the root
    0.005
    """

    thickness: tuple[float, ...]
    youngs_modulus: float = 70e9
    shear_modulus: float = 30e9
    allowable_stress: float = 80e6
    density: float = 2800.0
    origin: float = 0.35
    weight_ratio: float = 2.0

    @property
    def settings(self) -> dict:
        """Entries for OpenAeroStruct's dictionary of a surface."""
        return {
            "fem_model_type": "tube",
            "thickness_cp": np.array(self.thickness),
            "E": self.youngs_modulus,
            "G": self.shear_modulus,
            "yield": self.allowable_stress,
            "safety_factor": 1.0,
            "mrho": self.density,
            "fem_origin": self.origin,
            "wing_weight_ratio": self.weight_ratio,
            "struct_weight_relief": False,
            "distributed_fuel_weight": False,
            "exact_failure_constraint": False,
        }


class Aerostructure(Copied, om.Group):
    """Fuel burn, mass and stress of a flexible wing with a tubular spar in steady flight, by OpenAeroStruct.

    The radius of the tube follows from chord and thickness of the wing. The lattice bends with the spar under its own
    loads; OpenAeroStruct solves the coupled problem.

    ====================  ======  ====================  ======  ========================================================
    name                  role    shape                 units   meaning
    ====================  ======  ====================  ======  ========================================================
    ``camber_surface``    input   (n_chord, n_span, 3)  m       nodes of the wing in its jig, see `CamberSurface`
    ``t_over_c``          input   (n_span - 1)                  thickness relative to chord of every strip; 0.12
    ``spar_thickness``    input   (n_control)           m       see `Spar`
    ``alpha``             input   (1,)                  deg     angle of attack
    ``Mach_number``       input   (1,)
    ``velocity``          input   (1,)                  m/s
    ``density``           input   (1,)                  kg/m^3
    ``speed_of_sound``    input   (1,)                  m/s
    ``load_factor``       input   (1,)                          weight that is lifted, in weights
    ``empty_mass``        input   (1,)                  kg      without the wing's structure and without fuel
    ``flight_range``      input   (1,)                  m
    ``consumption``       input   (1,)                  1/s     weight of fuel per second and thrust
    ``fuel_burn``         output  (1,)                  kg      after Breguet
    ``structural_mass``   output  (1,)                  kg      of the wing
    ``wall_thickness``    output  (n_span - 1)          m       of the spar at every strip
    ``failure``           output  (1,)                          largest stress relative to the allowable one, less 1
    ``lift_deficit``      output  (1,)                          1 less lift relative to weight
    ``CL``, ``CD``        output  (1,)                          from the forces on the bound vortices, and the parasite
                                                                drag
    ``strip_lift``        output  (n_span - 1)                  lift coefficient of every strip
    ====================  ======  ====================  ======  ========================================================

    Options
    -------
    lattice : ndarray, shape (n_chord, n_span, 3)
        Nodes on the baseline, the left half of a symmetric wing; their places along the span parametrize the splines.
    spar : Spar
        The spar.
    parasite_drag : float
        Coefficient added to the induced drag.

    Raises
    ------
    InputError
        In ``setup``, if OpenAeroStruct is not installed.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.flow import Aerostructure, Spar
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.measures import CamberSurface, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((9, 8, 7))), "wing*")
    >>> lattice = CamberSurface.of(surface, 2, 5).evaluate(surface.points)
    >>> problem = om.Problem(Aerostructure(lattice=lattice, spar=Spar((0.003, 0.004))), reports=None)
    >>> _ = problem.setup()
    """

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            lattice: np.ndarray,
            spar: Spar,
            parasite_drag: float = 0.015,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("lattice", types=np.ndarray, recordable=False, desc="nodes on the baseline")
        self.options.declare("spar", types=Spar, recordable=False, desc="the spar")
        self.options.declare("parasite_drag", default=0.015, desc="added to the induced drag")

    @fails_together
    def setup(self) -> None:
        """Add OpenAeroStruct's groups."""
        lattice, spar = self.options["lattice"], self.options["spar"]
        drag = {"CL0": 0.0, "CD0": self.options["parasite_drag"], "with_viscous": False, "with_wave": False}
        laminar = {"k_lam": 0.0, "c_max_t": 0.3}  # required, though nothing viscous is computed
        settings: dict[str, Any] = drag | laminar | spar.settings
        n_chord, n_span = lattice.shape[:2]
        surface = lattice_surface(n_chord, n_span, **settings) | {"mesh": lattice}
        self._add_spar(surface)
        self._add_point(surface)
        defaults = {**_DEFAULTS, "camber_surface": (lattice, "m"), "spar_thickness": (surface["thickness_cp"], "m")}
        for name, (value, units) in defaults.items():
            self.set_input_defaults(name, val=value, units=units)
        self.set_input_defaults("t_over_c", val=np.full(lattice.shape[1] - 1, 0.12))

    def configure(self) -> None:
        """Promote what OpenAeroStruct leaves inside, and solve tightly enough for exact derivatives."""
        self.point.coupled.promotes("wing", inputs=[("mesh", "camber_surface")])
        self.point.promotes("coupled", inputs=["camber_surface"])
        self.point.promotes("wing_perf", outputs=["failure", "Cl"])
        self.promotes("point", inputs=["camber_surface"], outputs=["failure", ("Cl", "strip_lift")])
        self.point.coupled.nonlinear_solver.options.update({"atol": 1e-9, "rtol": 1e-14, "iprint": -1})

    def _add_spar(self, surface: dict[str, Any]) -> None:
        """Add the path from the mesh to the stiffness and the mass of the spar."""
        section = ["A", "Iy", "Iz", "J"]
        self.add_subsystem(
            "tube",
            openaerostruct("structures.tube_group").TubeGroup(surface=surface),
            promotes_inputs=[("mesh", "camber_surface"), "t_over_c", ("thickness_cp", "spar_thickness")],
            promotes_outputs=[*section, ("thickness", "wall_thickness")],
        )
        self.add_subsystem(
            "spar",
            openaerostruct("structures.spatial_beam_setup").SpatialBeamSetup(surface=surface),
            promotes_inputs=[("mesh", "camber_surface"), *section],
            promotes_outputs=["structural_mass"],
        )

    def _add_point(self, surface: dict[str, Any]) -> None:
        """Add the steady flight of the flexible wing."""
        self.add_subsystem(
            "point",
            openaerostruct("integration.aerostruct_groups").AerostructPoint(surfaces=[surface], compressible=True),
            promotes_inputs=[*STREAM, *_FLIGHT],
            promotes_outputs=[("fuelburn", "fuel_burn"), ("L_equals_W", "lift_deficit"), "CL", "CD"],
        )
        self.connect("spar.local_stiff_transformed", "point.coupled.wing.local_stiff_transformed")
        self.connect("spar.nodes", ["point.coupled.wing.nodes", "point.wing_perf.nodes"])
        self.connect("tube.radius", "point.wing_perf.radius")
        self.connect("wall_thickness", "point.wing_perf.thickness")
        self.connect("spar.cg_location", "point.total_perf.wing_cg_location")
        self.connect("structural_mass", "point.total_perf.wing_structural_mass")


_FLIGHT = [
    "alpha",
    "beta",
    "Mach_number",
    "speed_of_sound",
    "load_factor",
    ("W0", "empty_mass"),
    ("R", "flight_range"),
    ("CT", "consumption"),
]
"""OpenAeroStruct's names of the flight conditions, and the names here."""

_DEFAULTS = {
    "alpha": (4.0, "deg"),
    "beta": (0.0, "deg"),
    "Mach_number": (0.15, None),
    "velocity": (50.0, "m/s"),
    "density": (1.225, "kg/m**3"),
    "speed_of_sound": (340.0, "m/s"),
    "load_factor": (1.0, None),
    "empty_mass": (90.0, "kg"),
    "flight_range": (1e6, "m"),
    "consumption": (1e-4, "1/s"),
}
"""Values and units of the flight conditions: a small unmanned aeroplane."""
