"""The kinds of design variables of a study, and their keys.

To add one, add its line here, and what it makes to `script_shape`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .kinds import (
    BOUND,
    COORDINATES,
    CORNER,
    DIRECTION,
    FILES,
    FLAG,
    LATTICE,
    LINE,
    NAMES,
    NUMBERS,
    PART,
    PARTS,
    PLACES,
    POSITIVE,
    SLICES,
    STATIONS,
    TEXT,
    WHICH_KIND,
    Key,
    number,
    one_of,
    whole,
)

__all__ = ["VARIABLES", "VariableKind"]

_BOUNDS = {
    "lower": Key(BOUND, "lower bound", is_required=True),
    "upper": Key(BOUND, "upper bound", is_required=True),
    "start": Key(BOUND, "value to start from", otherwise="that of the baseline"),
    "ref": Key(POSITIVE, "change that the driver sees as 1", otherwise="half the distance of the bounds"),
}
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
_CAD = {
    "file": Key(TEXT, "STEP or IGES file of the walls, to whose nearest face each node is tied", is_required=True),
    "scale": Key(POSITIVE, "lengths of the grid by metres of that file", otherwise="by the unit of the grid"),
    "patches": Key(NAMES, "patches that are tied to it", otherwise="all that are designed"),
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
        return WHICH_KIND | _BOUNDS | self.keys


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
    "hicks_henne": VariableKind(
        "heights in chords, upwards, of bumps of Hicks and Henne on sides of sections; the upper ones first",
        {
            "places": Key(PLACES, "parts of the chord where they are highest, or how many", 6),
            "power": Key(number("a number from 0.1 to 100", 0.1, 100.0), "the larger, the narrower they are", 3.0),
            "sides": Key(one_of("both", "upper", "lower"), "sides that have bumps", "both"),
            **_SECTIONS,
        },
        "HicksHenne",
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
    "thickness_points": VariableKind(
        "thicknesses in chords of control points of a spline of thickness, from the leading edge on",
        {"n_points": Key(_MODES, "number of control points but those at the edges", 9), **_SECTIONS},
        "ThicknessPoints",
        modes=lambda table: table["n_points"],
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
    "cad_points": VariableKind(
        "displacements (m) of the control points of faces of a CAD file, which is written anew with the optimum",
        {
            **_CAD,
            "faces": Key(NAMES, "faces whose control points move; those of others are as they are", otherwise="all"),
            **_COORDINATES,
            **_LIMITS,
        },
        "CadPoints",
        "m",
    ),
    "cad_shapes": VariableKind(
        "parts of the way from a CAD file to others of the same faces: 0 as it is, 1 there",
        {**_CAD, "to": Key(FILES, "files that have the same faces moved, with a value each", is_required=True)},
        "CadShapes",
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
