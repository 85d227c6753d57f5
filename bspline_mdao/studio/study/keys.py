"""The keys of a study: what each may be, what it means, and what it is where it is left out.

Whoever reads, explains or documents a study reads these tables. To add a key, add its line here, and what it makes to
`script`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ...flow.functionals import numbers
from ...grids.cells.aggregates import AGGREGATES
from .kinds import (
    AXES,
    BETWEEN,
    BOUND,
    COORDINATES,
    CORNER,
    DIRECTION,
    FLAG,
    FRACTIONS,
    LATTICE,
    LINE,
    NAMES,
    NUMBER,
    NUMBERS,
    OF_VARIABLES,
    OPTIONS,
    PART,
    PARTS,
    PLACES,
    POINT,
    POSITIVE,
    SLICES,
    STATIONS,
    TEXT,
    TRIPLE,
    WEIGHT,
    Kind,
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
    "VARIABLES",
    "Flow",
    "Key",
    "MeasureKind",
    "VariableKind",
]


@dataclass(frozen=True)
class Key:
    """A key of a table."""

    kind: Kind  # what it may be
    meaning: str  # what it means, with its unit
    default: Any = None  # value where it is left out; None where there is none to write down
    otherwise: str = ""  # what happens where it is left out and there is no value to write down
    is_required: bool = False  # whether it has to be there


GRID = {
    "file": Key(
        TEXT,
        "PLOT3D or CGNS file, mesh without structure, MODEL.h5 of either, or built-in grid such as @onera_m6",
        is_required=True,
    ),
    "patches": Key(
        TEXT, "patches of the grid: a TOML or NMF file; kinds of markers of a mesh", otherwise="those of the grid file"
    ),
    "spacing": Key(
        POSITIVE,
        "spans of the lattice around the walls of a mesh without structure (m)",
        otherwise="a tenth of the walls' size",
    ),
    "n_control": Key(TRIPLE, "control points per direction in every block", otherwise="chosen from the grid"),
    "order": Key(whole(2, 16), "order of the B-splines, degree plus one", otherwise="4, or 3 in short directions"),
    "corrections": Key(whole(0, 100), "cycles of parameter correction of the fit", 0),
    "design": Key(NAMES, "patches that are designed", otherwise="all walls"),
    "fixed": Key(NAMES, "patches that stay where they are", otherwise="see moving_mesh"),
    "released": Key(NAMES, "patches that move freely with the grid", otherwise="none"),
    "sliding": Key(
        NAMES,
        "patches that slide in planes, or on cylinders, cones or surfaces of revolution",
        otherwise="symmetry planes",
    ),
}
"""Table ``[grid]``."""

_BOUNDS = {
    "lower": Key(BOUND, "lower bound", is_required=True),
    "upper": Key(BOUND, "upper bound", is_required=True),
    "start": Key(BOUND, "value to start from", otherwise="that of the baseline"),
    "ref": Key(POSITIVE, "change that the driver sees as 1", otherwise="half the distance of the bounds"),
}
_KIND = {"kind": Key(TEXT, "one of the kinds below", otherwise="the name of the table")}
_AT = {
    "at": Key(
        number("a number from -10 to 10", -10.0, 10.0),
        "part of the chord where the axis is, 0 leading and 1 trailing edge",
        0.25,
    )
}
_OF_PART = {
    "patches": Key(NAMES, "patches that move, with an axis or a box of their own", otherwise="all that are designed")
}
_STATIONS = {
    **_AT,
    **_OF_PART,
    "stations": Key(STATIONS, "stations along the axis with a value each", 1),
    "order": Key(one_of(2, 4), "order of the spline between them: 2 straight lines, 4 cubics", 4),
    "values": Key(NUMBERS, "which stations are variables, from 1 at the root; others stay", otherwise="all"),
}

_SECTIONS = {
    "stations": Key(STATIONS, "sections from root to tip with values of their own", 1),
    "order": _STATIONS["order"],
    **_OF_PART,
}
_MODES = whole(1, 50)

_COORDINATES = {"direction": Key(COORDINATES, "direction of the displacements", "xyz")}
_WHERE = {"where": Key(SLICES, "which points move, as slices in x, y and z from 0 on", otherwise="all")}
_LIMITS = {
    "low": Key(CORNER, "lower corner of the box whose points move, with its sides (m)", otherwise="no limit"),
    "high": Key(CORNER, "upper corner of that box (m)", otherwise="no limit"),
}
_HINGE = {
    "axis": Key(LINE, "two points of the hinge (m); angles turn by the right hand about it", otherwise="see chord"),
    "chord": Key(PART, "part of the chord along which the hinge is; angles turn the rear down", otherwise="see axis"),
    "span": Key(PARTS, "parts of the span between which it is", [0.0, 1.0]),
}


@dataclass(frozen=True)
class VariableKind:
    """A kind of design variable."""

    meaning: str  # what its values are
    keys: dict[str, Key]  # its keys besides bounds
    made_by: str = ""  # class of `bspline_mdao.design` that it is an object of; empty for an input of the flow
    units: str = ""  # units of its values, empty where they are numbers
    neutral: float = 0.0  # value that leaves the baseline as it is
    modes: Callable[[dict[str, Any]], int] | None = None  # number of its values for a section, of its keys

    @property
    def all_keys(self) -> dict[str, Key]:
        """Its keys, the common ones first."""
        return _KIND | _BOUNDS | self.keys


def _n_places(places: int | list[float]) -> int:
    """Number of places that are given, or how many there are to be."""
    return places if isinstance(places, int) else len(places)


VARIABLES = {
    "twist": VariableKind("angles (deg) of sections about the axis, nose up positive", _STATIONS, "Twist", "deg"),
    "sweep": VariableKind("angles (deg) by which sections shear downstream along the axis", _STATIONS, "Sweep", "deg"),
    "dihedral": VariableKind(
        "angles (deg) by which sections shear upwards along the span", _STATIONS, "Dihedral", "deg"
    ),
    "span": VariableKind("factors on lengths along the span", _STATIONS, "Span", neutral=1.0),
    "chord": VariableKind(
        "factors on the chord",
        _STATIONS | {"scales_thickness": Key(FLAG, "whether thickness over chord stays", True)},
        "Chord",
        neutral=1.0,
    ),
    "taper": VariableKind("factor on the ratio of tip and root chord", _AT | _OF_PART, "Taper", neutral=1.0),
    "thickness": VariableKind("factors on the thickness of sections", _STATIONS, "ThicknessFactor", neutral=1.0),
    "camber": VariableKind("camber added to sections, in chords", _STATIONS, "Camber"),
    "bumps": VariableKind(
        "heights in chords, upwards, of bumps of Hicks and Henne on sides of sections; the upper ones first",
        {
            "places": Key(PLACES, "parts of the chord where they are highest, or how many", 6),
            "power": Key(number("a number from 0.1 to 100", 0.1, 100.0), "the larger, the narrower they are", 3.0),
            "sides": Key(one_of("both", "upper", "lower"), "sides that have bumps", "both"),
            **_SECTIONS,
        },
        "Bumps",
        modes=lambda table: _n_places(table["places"]) * (2 if table["sides"] == "both" else 1),
    ),
    "class_shape": VariableKind(
        "weights in chords, upwards, of class-shape functions (CST): of the nose, above, below, of the trailing edge",
        {
            "degree": Key(_MODES, "degree of the Bernstein polynomials", 5),
            "nose": Key(FLAG, "whether the radius of the nose changes", True),
            "trailing": Key(FLAG, "whether the height of the trailing edge is a value", False),
            **_SECTIONS,
        },
        "ClassShape",
        modes=lambda table: 2 * table["degree"] + table["nose"] + table["trailing"],
    ),
    "camber_modes": VariableKind(
        "heights in chords of modes of camber, from the leading edge on",
        {
            "n_modes": Key(_MODES, "number of modes but those of the edges", 4),
            "leading": Key(FLAG, "whether the height of the leading edge is a value", False),
            "trailing": Key(FLAG, "whether the height of the trailing edge is a value", False),
            **_SECTIONS,
        },
        "CamberModes",
        modes=lambda table: table["n_modes"] + table["leading"] + table["trailing"],
    ),
    "thickness_modes": VariableKind(
        "thicknesses in chords of modes of thickness, from the leading edge on",
        {
            "n_modes": Key(_MODES, "number of modes", 4),
            "nose": Key(FLAG, "whether the radius of the nose changes", True),
            **_SECTIONS,
        },
        "ThicknessModes",
        modes=lambda table: table["n_modes"],
    ),
    "curve_points": VariableKind(
        "displacements (m) of the control points of a section, those of all planes along the span alike",
        {
            "direction": Key(DIRECTION, "direction of the displacements", "normal"),
            "edges": Key(FLAG, "whether points at the leading and the trailing edge are among them", False),
            **_OF_PART,
        },
        "CurvePoints",
        "m",
    ),
    "radius": VariableKind(
        "factors on the distance from an axis, at stations along it: hubs, casings, nozzles, bodies",
        {
            "axis": Key(LINE, "two points of the axis (m), station 0 and station 1", is_required=True),
            **{key: _STATIONS[key] for key in ("stations", "order", "values", "patches")},
        },
        "RadiusFactor",
        neutral=1.0,
    ),
    "translation": VariableKind(
        "displacements (m) of the surface as it is, or of patches: a wing along a fuselage",
        {"direction": Key(COORDINATES, "direction of the displacements", "xyz"), **_OF_PART},
        "Translation",
        "m",
    ),
    "control_points": VariableKind(
        "displacements (m) of the control points of the design surface, one by one",
        {
            "direction": Key(DIRECTION, "direction of the displacements", "normal"),
            "patches": Key(NAMES, "patches whose control points move", otherwise="all of the design surface"),
        },
        "Local",
        "m",
    ),
    "lattice": VariableKind(
        "displacements (m) of the points of a box-shaped free-form lattice about the design surface",
        {
            "n": Key(LATTICE, "points of the lattice in x, y and z", [4, 3, 3]),
            **_COORDINATES,
            **_WHERE,
            "margin": Key(
                number("a number from 0 to 10", 0.0, 10.0),
                "part of each extent by which the box is larger at both ends",
                0.05,
            ),
            **_OF_PART,
        },
        "FreeForm",
        "m",
    ),
    "ffd": VariableKind(
        "displacements (m) of the points of a free-form box (FFD) in a file, PLOT3D of pyGeo and DAFoam or SU2",
        {
            "file": Key(TEXT, "file of the box, in the units of the grid", is_required=True),
            "box": Key(TEXT, "name of the box (FFD_TAG) in a mesh of SU2", otherwise="the only one"),
            "parent": Key(TEXT, "variable above whose box this one is in, and moves with", otherwise="none"),
            "continuity": Key(
                whole(-1, 100), "derivatives that are continuous where the surface leaves the box; -1 fixes nothing", 1
            ),
            **_COORDINATES,
            **_WHERE,
            **_LIMITS,
            **_OF_PART,
        },
        "FreeForm",
        "m",
    ),
    "free_lattice": VariableKind(
        "displacements (m) of those points near the walls of the lattice around a mesh without structure",
        {
            "spacing": Key(POSITIVE, "spans of the lattice around the walls (m)", otherwise="those that move the mesh"),
            **_COORDINATES,
            **_LIMITS,
        },
        "FreeForm",
        "m",
    ),
    "rotation": VariableKind(
        "angle (deg) by which a part of the design surface turns about a hinge: flaps, tails, blades, bodies",
        {
            **_HINGE,
            "hinge": Key(TEXT, "variable above, of the kind hinge, about whose hinge it is", otherwise="see chord"),
            "patches": Key(
                NAMES, "patches that turn as wholes, such as those of a flap behind a gap", otherwise="none"
            ),
            "blend": Key(POSITIVE, "distance ahead of the hinge (m) over which turning fades", otherwise="see patches"),
            "ends": Key(
                number("a number from 0 to 1e20", 0.0),
                "distance beyond the ends of the hinge (m) over which turning fades; 0: not at all",
                otherwise="as blend",
            ),
        },
        "Rotation",
        "deg",
    ),
    "hinge": VariableKind(
        "displacements (m) of the two points of a hinge, of the first and then of the second",
        {**_HINGE, **_COORDINATES},
        "HingePoints",
        "m",
    ),
    "alpha": VariableKind("angle of attack (deg) of the flow", {}, units="deg"),
}
"""Tables ``[variables.NAME]`` by kind."""

_RELATIVE = {"relative": Key(FLAG, "whether it is divided by that of the baseline", True)}
_MEASURED = {"patches": Key(NAMES, "patches that are measured", otherwise="those that are designed")}
_MEASURE_STATIONS = {
    "stations": Key(FRACTIONS, "fractions of the span", otherwise="0.1, 0.5 and 0.9; of a section, its middle")
}


@dataclass(frozen=True)
class MeasureKind:
    """A kind of measure of the design surface."""

    meaning: str  # what it is
    keys: dict[str, Key]  # its keys besides ``kind`` and ``patches``
    made_by: str  # what makes it: a method of a class of `bspline_mdao.measures`, of the surface
    is_number: bool = True  # whether it is one number, which an objective has to be

    @property
    def all_keys(self) -> dict[str, Key]:
        """Its keys, the common ones first."""
        return _KIND | _MEASURED | self.keys


MEASURES = {
    "volume": MeasureKind("enclosed volume", _RELATIVE, "EnclosedVolume.of"),
    "surface_area": MeasureKind("wetted area", _RELATIVE, "SurfaceArea.of"),
    "planform_area": MeasureKind("planform area", _RELATIVE, "ProjectedArea.of"),
    "thickness": MeasureKind(
        "thickness on a grid of lines between the edges",
        {
            "n_chord": Key(whole(2, 200), "lines along the chord", 5),
            "n_span": Key(whole(1, 200), "lines along the span", otherwise="5; of a section, 1"),
            "chord": Key(PARTS, "parts of the chord between which they are", [0.05, 0.95]),
            "span": Key(PARTS, "parts of the span between which they are", [0.02, 0.98]),
            **_RELATIVE,
        },
        "Thickness.grid",
        is_number=False,
    ),
    "thickness_at": MeasureKind(
        "thickness at parts of the chord of sections",
        {
            "parts": Key(BETWEEN, "parts of the chord", [0.1, 0.3, 0.5, 0.7, 0.9]),
            **_MEASURE_STATIONS,
            **_RELATIVE,
        },
        "Thickness.of_sections",
        is_number=False,
    ),
    "section_area": MeasureKind("area of a section", _RELATIVE, "SectionArea.of"),
    "section_thickness": MeasureKind(
        "smooth bound of the largest thickness over chord of sections",
        _MEASURE_STATIONS | {"smallest": Key(FLAG, "whether the smallest is bounded instead", False)},
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
        "smooth lower bound of the distance (m) of the nodes of patches from those of others, which they do not touch",
        {
            "patches": Key(NAMES, "patches on one side, such as a flap", is_required=True),
            "to": Key(NAMES, "patches on the other side", is_required=True),
            "rho": Key(
                POSITIVE,
                "sharpness: 1 / rho of the distance on the baseline, times the logarithm of the number "
                "of pairs, is what the bound is below it",
                200.0,
            ),
        },
        "Clearance.between",
    ),
}
"""Tables ``[measures.NAME]`` by kind. One with all defaults need not be written: its name is enough."""

QUALITIES = {name: aggregate.meaning for name, aggregate in AGGREGATES.items()}
"""What objectives and constraints may say of the cells of the grid."""

_DEGREES = number("a number from -90 to 90", -90.0, 90.0)
_SUBSONIC, _MACH = number("a number from 0.001 to 0.99", 1e-3, 0.99), number("a number from 0.001 to 10", 1e-3, 10.0)
_FREE_STREAM = "Mach number of the free stream"
_STREAM = {
    "reference_area": Key(POSITIVE, "of what the grid shows, of the half wing if it shows one half (m^2)",
                          otherwise="planform area of the design surface"),
    "reference_chord": Key(POSITIVE, "for moments (m)", 1.0),
    "moment_reference": Key(POINT, "point that moments are about, in the axes of the grid (m)", [0.0, 0.0, 0.0]),
    "axes": Key(AXES, "axes of the grid downstream, along the span, up", "xzy"),
}  # fmt: skip
_ALPHA = {"alpha": Key(_DEGREES, "angle of attack (deg)", 2.0)}


@dataclass(frozen=True)
class Flow:
    """A flow."""

    meaning: str  # what it is
    made_by: str  # group of `bspline_mdao`
    keys: dict[str, Key]  # its keys besides ``kind``
    outputs: tuple[str, ...]  # its outputs that are one number


MOST_NODES = 1000
"""Nodes of a vortex lattice at most: its matrices are dense, 1.6 GB for 900 nodes with a gradient."""

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
            "n_span": Key(whole(3, 400), "and along the span", 17),
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
            "trim": Key(FLAG, "whether the angle of attack is solved for at the lift CL_target", False),
            "CL_target": Key(NUMBER, "lift coefficient of the trim", otherwise="needed with trim"),
            "tolerance": Key(POSITIVE, "residual, relative to that of the uniform stream, of a solution", 1e-12),
        },
        numbers("euler"),
    ),
}
"""Table ``[flow]`` by its key ``kind``."""

_POINT = {
    "alpha": Key(_DEGREES, "angle of attack (deg)", otherwise="that of [flow]"),
    "weight": Key(WEIGHT, "weight in the mean that the objective is; 0 for constraints alone", 1.0),
}
_LIFT = {"CL_target": Key(NUMBER, "lift coefficient at which alpha is solved for", otherwise="see [flow]")}
CONDITIONS = {
    "lattice": {"Mach_number": Key(_SUBSONIC, _FREE_STREAM, otherwise="that of [flow]"), **_POINT},
    "euler": {"Mach_number": Key(_MACH, _FREE_STREAM, otherwise="that of [flow]"), **_POINT, **_LIFT},
}
"""Tables ``[conditions.NAME]`` by the kind of the flow."""

_OF = Key(
    TEXT,
    "a measure, an aggregate of the cells' quality, an output of the flow or of one condition such as cruise.CL, or an "
    "expression of those that are one number, such as 'CD_induced + CD_entropy'",
)
OBJECTIVE = {
    "of": Key(_OF.kind, _OF.meaning, is_required=True),
    "maximize": Key(FLAG, "whether it is to be as large as possible", False),
    "ref": Key(POSITIVE, "value that the driver sees as 1", otherwise="0.01 for drag, 1 for others"),
}
"""Table ``[objective]``."""

CONSTRAINT = {
    "of": Key(_OF.kind, _OF.meaning, otherwise="the name of the table"),
    "lower": Key(NUMBER, "lower bound"),
    "upper": Key(NUMBER, "upper bound"),
    "equals": Key(NUMBER, "value that it is to have"),
    "ref": Key(POSITIVE, "value that the driver sees as 1", otherwise="size of the bound, 1 if that is 0"),
}
"""Tables ``[constraints.NAME]``."""

JUNCTION = {
    "body": Key(NAMES, "patches of a body that the rest of what is designed slides on",
                is_required=True),
    "reach": Key(POSITIVE, "distance from the junction over which displacements fade (m)", is_required=True),
    "shape": Key(OF_VARIABLES, "variables of the body's own shape, such as one of the kind radius", otherwise="none"),
}  # fmt: skip
"""Table ``[junction]``; none without it."""

MOVEMENT = {
    "mover": Key(one_of("rotations", "elasticity"), "what carries the control mesh along", "rotations"),
    "comoving": Key(FLAG, "whether the far field goes along with the rigid part of the motion", False),
    "increments": Key(
        whole(1, 1000), "increments of elasticity", otherwise="the least of 1, 2, 5, 10 that bounds need"
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
"""Optimizers of SciPy: whether they take inequality and equality constraints."""

DRIVER = {
    "optimizer": Key(TEXT, "of NLopt, such as LD_SLSQP, or of SciPy: " + ", ".join(SCIPY), "LD_SLSQP"),
    "tolerance": Key(POSITIVE, "change of the objective at which it ends: relative (NLopt), or SciPy's tol", 1e-6),
    "max_iterations": Key(whole(1, 10**9), "at most so many evaluations (NLopt) or iterations (SciPy)", 100),
    "options": Key(OPTIONS, "other options of NLoptDriver or ScipyDriver by their names", otherwise="none"),
}
"""Table ``[driver]``."""

OUTPUT = {
    "grid": Key(
        one_of("xyz", "fmt", "cgns", "vtm"),
        "suffix of the grids before and after",
        otherwise="cgns for CGNS, else xyz",
    ),
    "report": Key(
        FLAG, "whether the report page is written; it needs plotly and jinja2", otherwise="if they are there"
    ),
    "estimate_errors": Key(
        FLAG,
        "whether lift and drag in Euler flow, at the end, come with estimates for a grid of half as many cells again "
        "per direction; on one process",
        True,
    ),
}
"""Table ``[output]``."""
