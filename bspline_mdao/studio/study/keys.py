"""The keys of a study, except for its variables: possible values, meanings and defaults.

Readers, messages and documentation of studies use these tables. To add a key, add its line here, and its effect to
`script`.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...flow.functionals import numbers
from ...grids.cells.aggregates import AGGREGATES
from .kinds import (
    AXES,
    BETWEEN,
    FINER,
    FLAG,
    FRACTIONS,
    NAMES,
    NUMBER,
    OF_VARIABLES,
    OPTIONS,
    PARTS,
    POINT,
    POSITIVE,
    TEXT,
    TRIPLE,
    WEIGHT,
    WHICH_KIND,
    Key,
    number,
    one_of,
    whole,
)

__all__ = [
    "CONDITIONS",
    "CONSTRAINT",
    "DRIVER",
    "FLOWS",
    "GRID",
    "JUNCTION",
    "MEASURES",
    "MOST_NODES",
    "MOVEMENT",
    "OBJECTIVE",
    "OUTPUT",
    "QUALITIES",
    "SCIPY",
    "Flow",
    "MeasureKind",
]


GRID = {
    "file": Key(
        TEXT,
        "PLOT3D or CGNS file, unstructured mesh, MODEL.h5 of either, or built-in grid such as @onera_m6",
        is_required=True,
    ),
    "patches": Key(
        TEXT,
        "patches of the grid: a TOML or NMF file; for a mesh, kinds of its markers",
        otherwise="from the grid file",
    ),
    "spacing": Key(
        POSITIVE,
        "spans of the lattice around the walls of an unstructured mesh (m)",
        otherwise="a tenth of the walls' size",
    ),
    "n_control": Key(TRIPLE, "control points per direction in every block", otherwise="chosen from the grid"),
    "order": Key(whole(2, 16), "order of the B-splines, degree plus one", otherwise="4, or 3 in short directions"),
    "corrections": Key(whole(0, 100), "cycles of parameter correction of the fit", 0),
    "design": Key(NAMES, "designed patches", otherwise="all walls"),
    "fixed": Key(NAMES, "patches that stay where they are", otherwise="see moving_mesh"),
    "released": Key(NAMES, "patches that move freely with the grid", otherwise="none"),
    "sliding": Key(
        NAMES,
        "patches that slide in planes, or on cylinders, cones or surfaces of revolution",
        otherwise="symmetry planes",
    ),
}
"""Table ``[grid]``."""

_RELATIVE = {"relative": Key(FLAG, "whether to divide by the baseline's value", True)}
_MEASURED = {"patches": Key(NAMES, "measured patches", otherwise="the designed patches")}
_MEASURE_STATIONS = {
    "stations": Key(FRACTIONS, "fractions of the span", otherwise="0.1, 0.5 and 0.9; for a section its middle")
}


@dataclass(frozen=True)
class MeasureKind:
    """A kind of measure of the design surface."""

    meaning: str  # what it is
    keys: dict[str, Key]  # its keys besides ``kind`` and ``patches``
    made_by: str  # what makes it: a method of a class of `bspline_mdao.measures`, taking the surface
    is_number: bool = True  # whether it is a scalar, as an objective must be

    @property
    def all_keys(self) -> dict[str, Key]:
        """Its keys, the common ones first."""
        return WHICH_KIND | _MEASURED | self.keys


MEASURES = {
    "volume": MeasureKind("enclosed volume", _RELATIVE, "EnclosedVolume.of"),
    "surface_area": MeasureKind("wetted area", _RELATIVE, "SurfaceArea.of"),
    "planform_area": MeasureKind("planform area", _RELATIVE, "ProjectedArea.of"),
    "thickness": MeasureKind(
        "thickness on a grid of lines between the edges",
        {
            "n_chord": Key(whole(2, 200), "lines along the chord", 5),
            "n_span": Key(whole(1, 200), "lines along the span", otherwise="5; for a section 1"),
            "chord": Key(PARTS, "range of the chord that they cover, as fractions", [0.05, 0.95]),
            "span": Key(PARTS, "range of the span that they cover, as fractions", [0.02, 0.98]),
            **_RELATIVE,
        },
        "Thickness.grid",
        is_number=False,
    ),
    "thickness_at": MeasureKind(
        "thickness of sections at fractions of the chord",
        {
            "parts": Key(BETWEEN, "fractions of the chord", [0.1, 0.3, 0.5, 0.7, 0.9]),
            **_MEASURE_STATIONS,
            **_RELATIVE,
        },
        "Thickness.of_sections",
        is_number=False,
    ),
    "section_area": MeasureKind("area of a section", _RELATIVE, "SectionArea.of"),
    "section_thickness": MeasureKind(
        "smooth bound of the largest thickness over chord of sections",
        _MEASURE_STATIONS | {"smallest": Key(FLAG, "whether to bound the smallest instead", False)},
        "SectionThickness.at",
        is_number=False,
    ),
    "leading_edge_radius": MeasureKind(
        "radius of the leading edge at stations",
        _MEASURE_STATIONS
        | {"relative_to": Key(one_of("metre", "chord", "baseline"), "what the radius is divided by", "baseline")},
        "LeadingEdgeRadius.at",
        is_number=False,
    ),
    "trailing_edge_angle": MeasureKind(
        "wedge angle (rad) of the trailing edge at stations", _MEASURE_STATIONS, "TrailingEdgeAngle.at", is_number=False
    ),
    "curvature": MeasureKind("integral of the curvature", _RELATIVE, "Curvature.integral"),
    "clearance": MeasureKind(
        "smooth lower bound of the distance (m) between the nodes of patches and of others that they do not touch",
        {
            "patches": Key(NAMES, "patches on one side, such as a flap", is_required=True),
            "to": Key(NAMES, "patches on the other side", is_required=True),
            "rho": Key(
                POSITIVE,
                "sharpness: the bound is at most ln(number of pairs) / rho of the baseline's distance below the "
                "distance",
                200.0,
            ),
        },
        "Clearance.between",
    ),
}
"""Tables ``[measures.NAME]`` by kind. A table with only defaults may be left out: its name is enough."""

QUALITIES = {name: aggregate.meaning for name, aggregate in AGGREGATES.items()}
"""Measures of the cells of the grid for objectives and constraints."""

_DEGREES = number("a number from -90 to 90", -90.0, 90.0)
_SUBSONIC, _MACH = number("a number from 0.001 to 0.99", 1e-3, 0.99), number("a number from 0.001 to 10", 1e-3, 10.0)
_FREE_STREAM = "Mach number of the free stream"
_STREAM = {
    "reference_area": Key(POSITIVE, "reference area of what is in the grid, so for half a wing half the area (m^2)",
                          otherwise="planform area of the design surface"),
    "reference_chord": Key(POSITIVE, "reference length of moments (m)", 1.0),
    "moment_reference": Key(POINT, "point about which moments are taken, in the axes of the grid (m)", [0.0, 0.0, 0.0]),
    "axes": Key(AXES, "axes of the grid downstream, along the span, up", "xzy"),
}  # fmt: skip
_ALPHA = {"alpha": Key(_DEGREES, "angle of attack (deg)", 2.0)}


@dataclass(frozen=True)
class Flow:
    """A flow."""

    meaning: str  # what it is
    made_by: str  # group of `bspline_mdao`
    keys: dict[str, Key]  # its keys besides ``kind``
    outputs: tuple[str, ...]  # its scalar outputs


MOST_NODES = 1000
"""Largest number of nodes of a vortex lattice: its matrices are dense, 1.6 GB for 900 nodes with a gradient."""

FLOWS = {
    "lattice": Flow(
        "vortex lattice of the half wing",
        "LatticeFlow",
        {
            "kind": Key(one_of("lattice", "euler"), "flow model", is_required=True),
            **_ALPHA,
            "Mach_number": Key(_SUBSONIC, _FREE_STREAM, 0.3),
            **_STREAM,
            "n_chord": Key(whole(2, 100), "nodes of the lattice along the chord", 5),
            "n_span": Key(whole(3, 400), "nodes of the lattice along the span", 17),
        },
        numbers("lattice"),
    ),
    "euler": Flow(
        "Euler equations on all blocks of the grid",
        "EulerFlow",
        {
            "kind": Key(one_of("lattice", "euler"), "flow model", is_required=True),
            **_ALPHA,
            "Mach_number": Key(_MACH, _FREE_STREAM, 0.3),
            **_STREAM,
            "trim": Key(FLAG, "whether to solve for the angle of attack that gives the lift CL_target", False),
            "CL_target": Key(NUMBER, "lift coefficient of the trim", otherwise="required with trim"),
            "tolerance": Key(POSITIVE, "residual of a solution, relative to the uniform stream", 1e-12),
            "anchored": Key(
                FLAG, "whether a flow starts from the flow of the last gradient instead of the last flow", False
            ),
        },
        numbers("euler"),
    ),
}
"""Table ``[flow]`` by its key ``kind``."""

_POINT = {
    "alpha": Key(_DEGREES, "angle of attack (deg)", otherwise="from [flow]"),
    "weight": Key(WEIGHT, "weight in the mean objective; 0 for a condition with constraints only", 1.0),
}
_LIFT = {"CL_target": Key(NUMBER, "lift coefficient at which alpha is solved for", otherwise="see [flow]")}
CONDITIONS = {
    "lattice": {"Mach_number": Key(_SUBSONIC, _FREE_STREAM, otherwise="from [flow]"), **_POINT},
    "euler": {"Mach_number": Key(_MACH, _FREE_STREAM, otherwise="from [flow]"), **_POINT, **_LIFT},
}
"""Tables ``[conditions.NAME]`` by the kind of the flow."""

_OF = Key(
    TEXT,
    "a measure, a quality of the cells, an output of the flow or of one condition such as cruise.CL, or an "
    "expression of scalars such as 'CD_induced + CD_entropy'",
)
OBJECTIVE = {
    "of": Key(_OF.kind, _OF.meaning, is_required=True),
    "maximize": Key(FLAG, "whether to maximise it", False),
    "ref": Key(POSITIVE, "value that the driver sees as 1", otherwise="0.01 for drag, otherwise 1"),
}
"""Table ``[objective]``."""

CONSTRAINT = {
    "of": Key(_OF.kind, _OF.meaning, otherwise="the name of the table"),
    "lower": Key(NUMBER, "lower bound"),
    "upper": Key(NUMBER, "upper bound"),
    "equals": Key(NUMBER, "required value"),
    "ref": Key(POSITIVE, "value that the driver sees as 1", otherwise="magnitude of the bound, 1 if it is 0"),
}
"""Tables ``[constraints.NAME]``."""

JUNCTION = {
    "body": Key(NAMES, "patches of the body on which the other designed patches slide", is_required=True),
    "reach": Key(POSITIVE, "distance from the junction over which displacements fade (m)", is_required=True),
    "rigid": Key(
        number("a number from 0 to 1e20", 0.0),
        "distance within which everything moves rigidly, such as a fillet (m); less than reach",
        0.0,
    ),
    "shape": Key(OF_VARIABLES, "variables of the body's own shape, such as one of the kind radius", otherwise="none"),
}
"""Table ``[junction]``; optional."""

MOVEMENT = {
    "mover": Key(one_of("rotations", "elasticity"), "what moves the control mesh", "rotations"),
    "comoving": Key(FLAG, "whether the far field follows the rigid part of the motion", False),
    "increments": Key(
        whole(1, 1000), "increments of elasticity", otherwise="smallest of 1, 2, 5, 10 that the bounds need"
    ),
    "poisson_ratio": Key(NUMBER, "Poisson's ratio of elasticity", -0.2),
}
"""Table ``[movement]``."""

SCIPY = {
    "SLSQP": (True, True),
    "trust-constr": (True, True),
    "COBYLA": (True, False),
    "L-BFGS-B": (False, False),
    "TNC": (False, False),
}
"""Optimizers of SciPy: whether they accept inequality and equality constraints."""

DRIVER = {
    "optimizer": Key(TEXT, "of NLopt, such as LD_SLSQP, or of SciPy: " + ", ".join(SCIPY), "LD_SLSQP"),
    "tolerance": Key(POSITIVE, "relative change of the objective at which it ends (NLopt), or SciPy's tol", 1e-6),
    "max_iterations": Key(whole(1, 10**9), "largest number of evaluations (NLopt) or iterations (SciPy)", 100),
    "even_pressures": Key(
        OF_VARIABLES,
        "variables that the driver sees as combinations along which pressures change evenly; their bounds become "
        "constraints",
        otherwise="none",
    ),
    "options": Key(OPTIONS, "other options of NLoptDriver or ScipyDriver, by name", otherwise="none"),
}
"""Table ``[driver]``."""

OUTPUT = {
    "grid": Key(
        one_of("xyz", "fmt", "cgns", "vtm"),
        "format of the grids before and after, as a suffix",
        otherwise="cgns for CGNS, else xyz",
    ),
    "report": Key(FLAG, "whether to write the report page; needs plotly and jinja2", otherwise="if they are installed"),
    "picture": Key(
        FLAG,
        "whether to draw a section and its pressures before and after; Euler flow, needs matplotlib",
        otherwise="if it is installed",
    ),
    "estimate_errors": Key(
        FLAG,
        "whether to estimate lift and drag of the optimum in Euler flow on a grid with 1.5 times the cells per "
        "direction; one process",
        True,
    ),
    "solved_on": Key(
        FINER,
        "factor on the cells per direction of a finer grid on which the Euler flow is solved again, before and after, "
        "to confirm the gain; one process",
        otherwise="none",
    ),
}
"""Table ``[output]``."""
