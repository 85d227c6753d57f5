"""The part of a study's script that makes variables, measures, mover and the movement of the grid."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from .keys import MEASURES, MOVEMENT, QUALITIES
from .kinds import Key, slices_of
from .study import CAD_KINDS, Study
from .syntax import call, expression, statement
from .tables import Table
from .variable_kinds import VARIABLES

__all__ = ["changed", "shape_part"]

_OF_WINGS = {"n_span": 5, "stations": [0.1, 0.5, 0.9]}
"""Default settings of measures of wings; a section has one station."""

QUARTER = 0.25
"""Position of the reference axis of a wing along the chord."""


def shape_part(
    study: Study,  # the study
    path_of: Callable[[str], ast.expr],  # makes the path of a file in the study
    is_judged: bool = True,  # whether the movement of the grid refuses inverted cells, and computes their quality
) -> Iterator[ast.stmt | str]:
    """Statements that make ``variables``, ``measures``, ``mover`` and ``shape`` of ``model`` and ``wing``."""
    moved = {_names(part): part for _, table in _moving(study) if (part := _part(table))}
    if moved:
        yield statement("parts = made", made={name: call("wing.part", part) for name, part in moved.items()})
    with_axes = [table for _, table in _moving(study) if table.get("at", QUARTER) != QUARTER]
    if with_axes:
        axes = {_place(t): expression("wing.axis_at(at)", wing=_surface(_part(t)), at=t["at"]) for t in with_axes}
        yield statement("axes = made", made=dict(sorted(axes.items(), key=str)))
    lattices = {name: table for name, table in _moving(study) if table["kind"] in ("ffd", "free_lattice")}
    if lattices:
        yield statement("lattices = {}")
    for name, table in lattices.items():
        yield statement("lattices[name] = made", name=name, made=_lattice(table, path_of))
    hinges = {name: made for name, table in _moving(study) if (made := _hinge(table)) is not None}
    if hinges:
        yield statement("hinges = made", made=hinges)
    on_cad = {name: table for name, table in _moving(study) if table["kind"] in CAD_KINDS}
    if on_cad:
        yield "# each wall node is on the face of a CAD file that is nearest, and goes where that goes"
        ties = {table["file"]: _tied(table, study.grid["design"], path_of) for table in on_cad.values()}
        yield statement("tied = made", made=ties)
        yield statement("cad = made", made={name: _on_cad(name, table, path_of) for name, table in on_cad.items()})
    yield statement("variables = made", made=[_variable(name, table) for name, table in _moving(study)])
    if study.measures:
        measured = {_names(part): part for table in study.measures.values() if (part := _measured(table))}
        if measured:
            grid = "bm.measures.SurfaceGrid.of"
            of = {name: call(grid, expression("model"), part) for name, part in measured.items()}
            yield statement("surfaces = made", made=of)
        yield statement("measures = made", made=[_measure(*item) for item in study.measures.items()])
    yield from study.kind.mover_part(lambda: _mover(study))
    settings: dict[str, Any] = {"measures": expression("measures")} if study.measures else {}
    if study.junction:
        on_body = call("bm.design.OnPatch", expression("model"), study.junction["body"])
        names = study.junction["shape"]
        more: dict[str, Any] = {"shape": [names] if isinstance(names, str) else names} if names else {}
        more |= {"rigid": study.junction["rigid"]} if study.junction["rigid"] else {}
        settings["junction"] = call("bm.design.Junction", on_body, reach=study.junction["reach"], **more)
    settings |= study.kind.movement
    settings |= {"comoving": True} if study.movement["comoving"] else {}
    asked = [name for name in QUALITIES if is_judged and any(name in of for of in study.responses)]
    settings |= {"quality": asked or False, "fit": False} | ({} if is_judged else {"require_valid": False})
    yield statement("shape = made", made=call("wing.grid_movement", expression("variables"), **settings))
    if study.flow and study.evened:
        settings |= {"quality": False}
        yield statement("shape_at_first = made", made=call("wing.grid_movement", expression("variables"), **settings))


def _moving(study: Study) -> list[tuple[str, Table]]:
    """Variables that move the grid."""
    return [(name, table) for name, table in study.variables.items() if VARIABLES[table["kind"]].made_by]


def _part(table: Table) -> str | list[str] | None:
    """Patches that a variable moves as a surface of their own; None if it moves all, or control points of all."""
    return None if table["kind"] in ("control_points", "rotation") else table.get("patches")


def _surface(part: str | list[str] | None) -> ast.expr:
    """The design surface, or a part of it."""
    return expression("parts[part]", part=_names(part)) if part else expression("wing")


def _place(table: Table) -> float | tuple[str, float]:
    """Name of the axis of a variable: its position along the chord, with the name of its part of the surface if any."""
    part = _part(table)
    return (_names(part), table["at"]) if part else table["at"]


def _variable(name: str, table: Table) -> ast.expr:
    part = _part(table)
    made = _made_variable(name, table)
    return call("bm.design.OfPart", made, expression("part.mesh", part=_surface(part))) if part else made


def _made_variable(name: str, table: Table) -> ast.expr:
    kind = VARIABLES[table["kind"]]
    made_by = f"bm.design.{kind.made_by}"
    if table["kind"] == "control_points":
        patches = [table["patches"]] if table["patches"] else []
        where = [call("bm.design.OnPatch", expression("model"), names) for names in patches]
        return call(made_by, name, *where, direction=table["direction"])
    if table["kind"] in CAD_KINDS:
        return expression("cad[name]", name=name)
    if table["kind"] == "radius":
        settings = {"stations": table["stations"]} | changed(table, kind.keys, ("order",))
        return call(made_by, name, [tuple(point) for point in table["axis"]], **settings)
    if table["kind"] == "translation":
        return call(made_by, name, direction=table["direction"])
    if kind.modes is not None:
        settings = changed(table, kind.keys, ("power", "nose", "leading", "trailing", "stations", "order"))
        if table.get("sides", "both") != "both":
            settings["sides"] = table["sides"]
        size = next(table[key] for key in ("places", "degree", "n_modes", "n_points") if key in table)
        return call(made_by, name, size, **settings)
    if table["kind"] == "curve_points":
        return call(made_by, name, **changed(table, kind.keys, ("direction", "edges")))
    if table["kind"] == "lattice":
        settings = changed(table, kind.keys, ("margin",))
        box = call(
            "bm.design.Lattice.box", expression("wing.mesh", wing=_surface(_part(table))), tuple(table["n"]), **settings
        )
        which = [expression("np.s_[slices]", slices=_slices(table["where"]))] if table["where"] else []
        return call(made_by, name, box, *which, direction=table["direction"])
    if table["kind"] in ("ffd", "free_lattice"):
        lattice = expression("lattices[name]", name=name)
        which = [expression("np.s_[slices]", slices=_slices(table["where"]))] if table.get("where") else []
        limits = {key: _limits(table[key]) for key in ("low", "high") if table[key]}
        within = f"lattices[name].within({', '.join(f'{key}={key}' for key in limits)})"
        which += [expression(within, name=name, **limits)] if limits else []
        return call(made_by, name, lattice, *which, direction=table["direction"])
    if table["kind"] in ("rotation", "hinge"):
        about = expression("hinges[name]", name=table.get("hinge") or name)
        if table["kind"] == "hinge":
            return call(made_by, name, about, direction=table["direction"])
        patches = [call("bm.design.OnPatch", expression("model"), table["patches"])] if table["patches"] else []
        return call(made_by, name, about, *patches, **changed(table, kind.keys, ("blend", "ends")))
    axis = expression("wing.axis", wing=_surface(_part(table)))
    if table["at"] != QUARTER:
        axis = expression("axes[place]", place=_place(table))
    settings = {"stations": table["stations"]} if "stations" in table else {}
    settings |= changed(table, kind.keys, ("order", "scales_thickness"))
    return call(made_by, name, axis, **settings)


def _tied(table: Table, design: str | list[str] | None, path_of: Callable[[str], ast.expr]) -> ast.expr:
    """Walls that are tied to the faces of a CAD file."""
    patches = [names] if (names := table["patches"] or design) else []
    scale = {"scale": table["scale"]} if table["scale"] else {}
    return call("bm.design.TiedSurface.of", expression("model"), path_of(table["file"]), *patches, **scale)


def _on_cad(name: str, table: Table, path_of: Callable[[str], ast.expr]) -> ast.expr:
    """Variable of the faces that walls are tied to."""
    made_by, file = f"bm.design.{VARIABLES[table['kind']].made_by}", table["file"]
    tied = expression("tied[file]", file=file)
    if table["kind"] == "cad_shapes":
        way = f"tied[file].shape(to{', scale' if table['scale'] else ''})"
        shapes = [expression(way, file=file, to=path_of(to), scale=table["scale"]) for to in table["to"]]
        return call(made_by, name, tied, shapes)
    chosen = {key: _limits(table[key]) for key in ("low", "high") if table[key]}
    chosen |= {"faces": table["faces"]} if table["faces"] else {}
    within = f"tied[file].body.within({', '.join(f'{key}={key}' for key in sorted(chosen))})"
    where = {"where": expression(within, file=file, **chosen)} if chosen else {}
    return call(made_by, name, tied, **where, direction=table["direction"])


def _hinge(table: Table) -> ast.expr | None:
    """Hinge of a variable; None if it has none of its own."""
    if table["kind"] in ("rotation", "hinge") and table["axis"]:
        return call("bm.design.Hinge", *map(tuple, table["axis"]))
    if table["kind"] not in ("rotation", "hinge") or table["chord"] is None:
        return None
    span = {"span": tuple(table["span"])} if table["span"] != VARIABLES["hinge"].keys["span"].default else {}
    return call("bm.design.Hinge.on_chord", expression("wing.mesh"), table["chord"], **span)


def _lattice(table: Table, path_of: Callable[[str], ast.expr]) -> ast.expr:
    """Lattice of a file, or around the mesh."""
    if table["kind"] == "free_lattice":
        settings = call("bm.meshes.LatticeSettings", spacing=table["spacing"])
        coarser = expression("model.with_settings(settings)", settings=settings) if table["spacing"] else None
        return call("bm.meshes.free_lattice", coarser or expression("model"))
    box = [table["box"]] if table["box"] else []
    options = {"parent": expression("lattices[name]", name=table["parent"])} if table["parent"] else {}
    options |= changed(table, VARIABLES["ffd"].keys, ("continuity",))
    return call("bm.design.read_lattice", path_of(table["file"]), *box, **options)


def _limits(corner: list[float]) -> tuple[float | None, ...]:
    """Corner of a box as an argument of `within`."""
    return tuple(None if math.isinf(value) else value for value in corner)


def _slices(where: str) -> ast.Tuple:
    """Tree of the contents of an index's brackets."""
    parts: list[ast.expr] = []
    for part in slices_of(where) or ():
        if isinstance(part, int):
            parts.append(expression("index", index=part))
        else:
            ends = {name: None if (end := getattr(part, name)) is None else expression("end", end=end)
                    for name in ("start", "stop", "step")}  # fmt: skip
            parts.append(ast.Slice(ends["start"], ends["stop"], ends["step"]))
    return ast.Tuple(parts, ast.Load())


def _names(patches: str | list[str]) -> str:
    """Patches in one text."""
    return patches if isinstance(patches, str) else ", ".join(patches)


def _measured(table: Table) -> list[str]:
    """Patches of a measure, on both sides of a clearance; none for all designed patches."""
    sides = [table["patches"], table.get("to")]
    return [name for side in sides if side for name in ([side] if isinstance(side, str) else side)]


def _measure(name: str, table: Table) -> ast.expr:
    kind, patches = MEASURES[table["kind"]], _measured(table)
    surface = expression("surfaces[part]", part=_names(patches)) if patches else expression("wing.surface")
    sides = [table["patches"], table["to"]] if "to" in table else []
    always = ("n_chord", "n_span", "parts", "stations", "relative", "relative_to")
    keys = {key: spec for key, spec in kind.keys.items() if key not in ("patches", "to")}
    chosen = [key for key, spec in keys.items() if key in always or table[key] != spec.default]
    chosen.sort(key=lambda key: key == "relative_to")
    settings = {key: tuple(table[key]) if key in ("chord", "span") else table[key] for key in chosen}
    for key in (key for key in _OF_WINGS if key in settings and settings[key] is None):
        settings[key] = expression("None if wing.surface.is_section else of_wing", of_wing=_OF_WINGS[key])
    return call(f"bm.measures.{kind.made_by}", surface, *sides, **settings, name=name)


def _mover(study: Study) -> Iterator[ast.stmt | str]:
    """The mover; elasticity without a number of increments takes as many as the bounds of the variables need."""
    movement = study.movement
    if movement["mover"] == "rotations":
        yield statement("mover = bm.movers.Rotations(wing.mesh)")
        return
    settings = changed(movement, MOVEMENT, ("poisson_ratio",))
    increments: Any = movement["increments"]
    mesh = expression("wing.mesh")
    if increments is None:
        bounds = {name: (_at_bound(table, "lower"), _at_bound(table, "upper")) for name, table in _moving(study)}
        yield statement("bounds = made", made=bounds)
        yield statement("designs = wing.parametrization(variables).extremes(bounds)")
        yield "# the least increments with which the control mesh stays good there: the same in every design"
        whole = call("bm.movers.LinearElasticity", mesh, **settings)
        yield statement("n_increments = bm.movers.increments_for(whole, designs)", whole=whole)
        increments = expression("n_increments")
    yield statement("mover = made", made=call("bm.movers.LinearElasticity", mesh, n_increments=increments, **settings))


def _at_bound(table: Table, side: str) -> Any:
    """Bound of all values of a variable; values that the driver does not change stay as they are."""
    bound, chosen = table[side], table.get("values")
    if not chosen:
        return bound
    stations = table["stations"]
    found = [VARIABLES[table["kind"]].neutral] * (len(stations) if isinstance(stations, list) else stations)
    for value, each in zip(chosen, bound if isinstance(bound, list) else [bound] * len(chosen)):
        found[value - 1] = each
    return found


def changed(table: Mapping[str, Any], keys: Mapping[str, Key], names: tuple[str, ...]) -> dict[str, Any]:
    """Keys whose value is not the default."""
    return {key: table[key] for key in names if key in keys and table[key] not in (None, keys[key].default)}
