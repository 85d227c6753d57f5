"""A file that describes a wing and the grid about it: planform, sections, spacings.

To add a key, add its line to a table here.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ...core.generators.airfoil_file import airfoil
from ...core.generators.first_cell import first_cell_of
from ...core.generators.hh_wing import hh_wing_grid
from ...core.generators.kinked_planform import KinkedPlanform
from ...core.generators.wing import Planform, Section, Wing
from ...core.generators.wing_spacing import FarField, Spacing, default_spacing
from ...errors import InputError
from ...grids.topology.grid import Grid
from ..study.kinds import NUMBER, POINT, POSITIVE, TEXT, TRIPLE, Key, list_of, number
from ..study.tables import Table, Tables

__all__ = ["GRID", "PLANFORM", "SECTIONS", "STATIONS", "read_wing"]

_SPAN = number("a number from 0 to 1e20", 0.0, 1e20)
_SWEEP = number("a number of degrees from -79 to 79", -79.0, 79.0)

PLANFORM = {
    "root_chord": Key(POSITIVE, "chord in the plane of symmetry (m)", 1.0),
    "semi_span": Key(POSITIVE, "from the plane of symmetry to the tip (m)", otherwise="see stations"),
    "taper": Key(POSITIVE, "tip chord over root chord", 1.0),
    "sweep": Key(_SWEEP, "sweep of the leading edge (deg)", 0.0),
    "stations": Key(
        list_of(POINT, "a list of lists of three numbers"),
        "span, leading edge and chord (m) at root, kinks and tip, instead of the keys above",
        otherwise="a trapezoid",
    ),
    "tip_length": Key(
        POSITIVE, "length of span over which the tip is rounded (m)", otherwise="twice the thickness there"
    ),
}
"""Table ``[planform]``."""

SECTIONS = {
    "root": Key(TEXT, "section at the root, as the command airfoil takes it; files from here", is_required=True),
    "tip": Key(TEXT, "section at the tip, blended with the root section along the span", otherwise="the root section"),
}
"""Table ``[sections]``."""

STATIONS = {
    "span": Key(_SPAN, "span position (m), 0 at the root", is_required=True),
    "leading": Key(NUMBER, "coordinate x of the leading edge (m)", is_required=True),
    "chord": Key(POSITIVE, "chord (m)", is_required=True),
    "section": Key(
        TEXT,
        "section, as in [sections]; needed at the root",
        otherwise="blended between its neighbours; at the tip the last one",
    ),
}
"""Tables ``[[stations]]``, instead of ``[sections]`` and of the planform's numbers."""

GRID = {
    "nodes": Key(TRIPLE, "nodes per block along the stream, away from the wing and along the span", [23, 33, 17]),
    "first_cell": Key(POSITIVE, "height of the first cells (m)", otherwise="chosen from the nodes"),
    "y_plus": Key(POSITIVE, "the same in viscous units, estimated of a flat plate", otherwise="see first_cell"),
    "reynolds": Key(POSITIVE, "Reynolds number of the root chord, for y_plus", otherwise="none"),
    "leading": Key(POSITIVE, "cells at the leading edge (m)", otherwise="chosen from the nodes"),
    "trailing": Key(POSITIVE, "cells at the trailing edge (m)", otherwise="chosen from the nodes"),
    "tip": Key(POSITIVE, "cells at the tip (m)", otherwise="chosen from the nodes"),
    "root": Key(POSITIVE, "cells along the span at the root (m)", otherwise="twice the mean"),
    "far": Key(POSITIVE, "distance of the outer boundary (m)", otherwise="10 root chords"),
}
"""Table ``[grid]``."""

_TABLES = {"planform": PLANFORM, "sections": SECTIONS, "grid": GRID}


def read_wing(
    path: Path,
) -> tuple[Wing, Grid, float | None]:  # wing; grid; Reynolds number per metre, if given
    """Read the file, and make the wing and the H-H grid about it."""
    tables = Tables.read(path, "a planform", "give a file as 'bspline-mdao wing --help' shows one")
    tables.known(tables.document, (*_TABLES, "stations"), (), "table")
    planform, grid = (tables.table(name, _TABLES[name]) for name in ("planform", "grid"))
    wing = _of_stations(tables, planform) if "stations" in tables.document else _of_two_sections(tables, planform)
    form = wing.planform
    try:
        spacing = _spacing(form.root_chord, grid)
        far = FarField(grid["far"] or 10.0 * form.root_chord, 0.05 * form.root_chord)
        made = replace(hh_wing_grid(wing, grid["nodes"], spacing, far), source=f"H-H grid of {path.name}")
    except InputError as error:
        raise tables.refuse(("grid",), str(error)) from error
    return wing, made, grid["reynolds"] and grid["reynolds"] / form.root_chord


def _of_two_sections(tables: Tables, planform: Table) -> Wing:
    """The wing of a section at the root, and another one or none at the tip."""
    form, sections = _form(tables, planform), tables.table("sections", SECTIONS)
    root, tip = (sections[where] and _section(tables, sections[where], ("sections", where)) for where in SECTIONS)
    return Wing(form, root, tip, planform["tip_length"])


def _of_stations(tables: Tables, planform: Table) -> Wing:
    """The wing of stations with their own sections."""
    for name, keys in (("sections", SECTIONS), ("planform", PLANFORM.keys() - {"tip_length"})):
        if given := [key for key in tables.document.get(name, {}) if key in keys]:
            raise tables.refuse((name, given[0]), "and [[stations]] as well; give one of both")
    stations = tables.array("stations", STATIONS)
    sections = [
        each["section"] and _section(tables, each["section"], ("stations", str(number), "section"))
        for number, each in enumerate(stations, 1)
    ]
    if sections[0] is None:
        raise tables.refuse(("stations", "1"), f"has no key 'section' at the root; give {TEXT.words}")
    try:
        form = KinkedPlanform([[each[key] for key in ("span", "leading", "chord")] for each in stations])
    except InputError as error:
        raise tables.refuse(("stations",), str(error)) from error
    between = [(each["span"], found) for each, found in list(zip(stations, sections))[1:-1] if found]
    return Wing(form, sections[0], sections[-1], planform["tip_length"], between)


def _form(tables: Tables, planform: Table) -> Planform | KinkedPlanform:
    """The planform, from stations or as a trapezoid."""
    given = [name for name in ("root_chord", "semi_span", "taper", "sweep") if name in tables.document["planform"]]
    try:
        if planform["stations"] and given:
            raise InputError(f"stations, and {', '.join(given)} as well; give one of both")
        if planform["stations"]:
            return KinkedPlanform(planform["stations"])
        if planform["semi_span"] is None:
            raise InputError("needs 'semi_span', from the plane of symmetry to the tip (m), or 'stations'")
        return Planform(planform["root_chord"], planform["semi_span"], planform["taper"], planform["sweep"])
    except InputError as error:
        raise tables.refuse(("planform",), str(error)) from error


def _section(tables: Tables, name: str, path: tuple[str, ...]) -> Section:
    """The section of an airfoil that a key names; relative files start at the planform's folder."""
    file = tables.path.parent / name
    try:
        return airfoil(file if file.is_file() else name).section
    except (InputError, OSError) as error:
        raise tables.refuse(path, str(error)) from error


def _spacing(root_chord: float, grid: Table) -> Spacing:
    """Intervals next to the wing: given, or otherwise fitting the nodes."""
    asked = {name: grid[name] for name in ("leading", "trailing", "tip", "root")}
    asked["off_wall"] = first_cell_of(root_chord, grid["first_cell"], grid["y_plus"], grid["reynolds"])
    given = {name: value for name, value in asked.items() if value is not None}
    return replace(default_spacing(root_chord, grid["nodes"]), **given)
