"""The kinds of design variables of a study, and their keys.

To add one, add its line here, and its effect to `script_shape`.
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
    "start": Key(BOUND, "initial value", otherwise="the baseline's"),
    "ref": Key(POSITIVE, "change that the driver sees as 1", otherwise="half the distance between the bounds"),
}
_AT = {
    "at": Key(
        number("a number from -10 to 10", -10.0, 10.0),
        "position of the axis along the chord, from 0 (leading edge) to 1 (trailing edge)",
        0.25,
    )
}
_OF_PART = {
    "patches": Key(NAMES, "patches that move, with an axis or a box of their own", otherwise="all designed patches")
}
_STATIONS = {
    **_AT,
    **_OF_PART,
    "stations": Key(STATIONS, "stations along the axis, one value each", 1),
    "order": Key(one_of(2, 4), "order of the spline between them: 2 straight lines, 4 cubics", 4),
    "values": Key(NUMBERS, "stations that are variables, from 1 at the root; the others stay", otherwise="all"),
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
    "low": Key(CORNER, "lower corner of the region whose points move (m), limits included", otherwise="no limit"),
    "high": Key(CORNER, "upper corner of that region (m)", otherwise="no limit"),
}
_CAD = {
    "file": Key(TEXT, "STEP or IGES file of the walls; each node is tied to its nearest face", is_required=True),
    "scale": Key(POSITIVE, "length in the grid per metre in the file", otherwise="from the unit of the grid"),
    "patches": Key(NAMES, "patches that are tied to it", otherwise="all designed patches"),
}
_HINGE = {
    "axis": Key(LINE, "two points of the hinge (m); right-hand rule", otherwise="see chord"),
    "chord": Key(PART, "position of the hinge along the chord; positive is trailing edge down", otherwise="see axis"),
    "span": Key(PARTS, "ends of the hinge along the span, as fractions", [0.0, 1.0]),
}


@dataclass(frozen=True)
class VariableKind:
    """A kind of design variable."""

    meaning: str  # its values
    keys: dict[str, Key]  # its keys besides bounds
    made_by: str = ""  # its class in `bspline_mdao.design`; empty for an input of the flow
    units: str = ""  # units of its values, empty if they are numbers
    neutral: float = 0.0  # value that leaves the baseline unchanged
    modes: Callable[[dict[str, Any]], int] | None = None  # number of its values for a section, from its keys

    @property
    def all_keys(self) -> dict[str, Key]:
        """Its keys, the common ones first."""
        return WHICH_KIND | _BOUNDS | self.keys


def _n_places(places: int | list[float]) -> int:
    """Number of places: the length of the list, or the given number."""
    return places if isinstance(places, int) else len(places)


VARIABLES = {
    "twist": VariableKind("rotation of sections about the axis (deg), nose up positive", _STATIONS, "Twist", "deg"),
    "sweep": VariableKind("angles (deg) by which sections shear downstream along the axis", _STATIONS, "Sweep", "deg"),
    "dihedral": VariableKind(
        "angles (deg) by which sections shear upwards along the span", _STATIONS, "Dihedral", "deg"
    ),
    "span": VariableKind("factors on lengths along the span", _STATIONS, "Span", neutral=1.0),
    "chord": VariableKind(
        "factors on the chord",
        _STATIONS | {"scales_thickness": Key(FLAG, "whether thickness divided by chord stays the same", True)},
        "Chord",
        neutral=1.0,
    ),
    "taper": VariableKind("factor on the ratio of tip and root chord", _AT | _OF_PART, "Taper", neutral=1.0),
    "thickness": VariableKind("factors on the thickness of sections", _STATIONS, "ThicknessFactor", neutral=1.0),
    "camber": VariableKind("camber added to sections, in chords", _STATIONS, "Camber"),
    "hicks_henne": VariableKind(
        "heights of Hicks-Henne bumps on the sides of sections (chords), upwards; upper side first",
        {
            "places": Key(PLACES, "positions of the peaks along the chord, or their number", 6),
            "power": Key(number("a number from 0.1 to 100", 0.1, 100.0), "larger is narrower", 3.0),
            "sides": Key(one_of("both", "upper", "lower"), "sides that have bumps", "both"),
            **_SECTIONS,
        },
        "HicksHenne",
        modes=lambda table: _n_places(table["places"]) * (2 if table["sides"] == "both" else 1),
    ),
    "class_shape": VariableKind(
        "weights of class-shape functions (CST, chords), upwards: nose, upper side, lower side, trailing edge",
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
        "heights of camber modes (chords), from the leading edge",
        {
            "n_modes": Key(_MODES, "number of modes, without those of the edges", 4),
            "leading": Key(FLAG, "whether the height of the leading edge is a value", False),
            "trailing": Key(FLAG, "whether the height of the trailing edge is a value", False),
            **_SECTIONS,
        },
        "CamberModes",
        modes=lambda table: table["n_modes"] + table["leading"] + table["trailing"],
    ),
    "thickness_modes": VariableKind(
        "heights of thickness modes (chords), from the leading edge",
        {
            "n_modes": Key(_MODES, "number of modes", 4),
            "nose": Key(FLAG, "whether the radius of the nose changes", True),
            **_SECTIONS,
        },
        "ThicknessModes",
        modes=lambda table: table["n_modes"],
    ),
    "thickness_points": VariableKind(
        "thickness at control points of a spline (chords), from the leading edge",
        {"n_points": Key(_MODES, "number of control points, without those at the edges", 9), **_SECTIONS},
        "ThicknessPoints",
        modes=lambda table: table["n_points"],
    ),
    "curve_points": VariableKind(
        "displacements (m) of the control points of a section, the same in all planes along the span",
        {
            "direction": Key(DIRECTION, "direction of the displacements", "normal"),
            "edges": Key(FLAG, "whether points at the leading and trailing edge are included", False),
            **_OF_PART,
        },
        "CurvePoints",
        "m",
    ),
    "radius": VariableKind(
        "factors on the distance from an axis, at stations along it, for hubs, casings, nozzles and bodies",
        {
            "axis": Key(LINE, "two points of the axis (m), station 0 and station 1", is_required=True),
            **{key: _STATIONS[key] for key in ("stations", "order", "values", "patches")},
        },
        "RadiusFactor",
        neutral=1.0,
    ),
    "translation": VariableKind(
        "displacements (m) of the whole surface or of patches, such as a wing along a fuselage",
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
                "fraction of each extent by which the box is enlarged at both ends",
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
            "parent": Key(TEXT, "earlier variable whose box contains this one and moves it", otherwise="none"),
            "continuity": Key(
                whole(-1, 100), "continuous derivatives where the surface leaves the box; -1 for none", 1
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
        "displacements (m) of points near the walls of the lattice around an unstructured mesh",
        {
            "spacing": Key(
                POSITIVE, "spans of the lattice around the walls (m)", otherwise="as in the lattice that moves the mesh"
            ),
            **_COORDINATES,
            **_LIMITS,
        },
        "FreeForm",
        "m",
    ),
    "cad_points": VariableKind(
        "displacements (m) of the control points of faces of a CAD file; the optimum is written as a new CAD file",
        {
            **_CAD,
            "faces": Key(NAMES, "faces whose control points move; the others stay", otherwise="all"),
            **_COORDINATES,
            **_LIMITS,
        },
        "CadPoints",
        "m",
    ),
    "cad_shapes": VariableKind(
        "interpolation from one CAD file (0) to others with the same faces (1)",
        {**_CAD, "to": Key(FILES, "files with the same faces, moved; one value each", is_required=True)},
        "CadShapes",
    ),
    "rotation": VariableKind(
        "rotation (deg) of a part of the design surface about a hinge: flaps, tails, blades, bodies",
        {
            **_HINGE,
            "hinge": Key(TEXT, "earlier variable of kind hinge", otherwise="see chord"),
            "patches": Key(NAMES, "patches that rotate rigidly, such as a flap behind a gap", otherwise="none"),
            "blend": Key(
                POSITIVE, "distance ahead of the hinge (m) over which the rotation fades", otherwise="see patches"
            ),
            "ends": Key(
                number("a number from 0 to 1e20", 0.0),
                "distance beyond the ends of the hinge (m) over which the rotation fades; 0 for a sharp end",
                otherwise="as blend",
            ),
        },
        "Rotation",
        "deg",
    ),
    "hinge": VariableKind(
        "displacements (m) of the two points of a hinge, first point first",
        {**_HINGE, **_COORDINATES},
        "HingePoints",
        "m",
    ),
    "alpha": VariableKind("angle of attack (deg) of the flow", {}, units="deg"),
}
"""Tables ``[variables.NAME]`` by kind."""
