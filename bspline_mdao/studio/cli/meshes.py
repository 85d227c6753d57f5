"""The commands ``inspect`` and ``quality`` for unstructured meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...core.background.mesh_model import MeshModel
from ...core.background.periodic_sides import find_periodic_sides
from ...errors import InputError
from ...grids.cells.certificate import Certificate
from ...grids.cells.mesh_heights import height_quantiles, mesh_wall_spacings
from ...grids.cells.mesh_quality import BEYOND, SEVERE, SKEWED, MeshQuality, mesh_quality
from ...grids.cells.mixed_bounds import certify_mixed
from ...grids.cells.mixed_cells import CellQuality, MixedMesh, face_keys
from ...grids.cells.node_heights import NodeHeights
from ...grids.cells.skin_parts import with_markers
from ...grids.cells.wall_spacing import WallSpacing
from ...grids.io.disk import replaced_file
from ...grids.io.formats import MODEL
from ...grids.io.marker_guess import MarkerGuess
from ...grids.io.marker_kinds import doubtful_kinds, draft_kinds, marker_kinds, undecided
from ...grids.io.meshes.files import read_mesh
from ...grids.topology.length_unit import in_unit
from .mesh_periodic import gap_lines, side_numbers
from .output import (
    certificate_numbers,
    check_outputs,
    measure_of_cells,
    print_lines,
    print_table,
    print_title,
    print_warnings,
    show_certificate,
    spacing_numbers,
    unproved_lines,
    written_json,
)

MOST_LISTED = 10
"""Largest number of inverted cells to print."""

MOST_NUMBERED = 100
"""Largest number of inverted cells to write as JSON."""


def inspect_mesh(
    name: str,  # the file
    patches: Path | None,  # declared kinds of its markers
    draft: Path | None,  # draft, json: TOML file of kinds to start from, and numbers, to write
    json: Path | None,
    reynolds: float | None,  # Reynolds number per unit of length, for an estimate of y+
    units: str | None,  # unit of lengths
) -> None:
    """Show the cells and markers of a mesh, what its markers seem to be, and what to declare to move it."""
    check_outputs([draft, json], [name, patches])
    with progress_bar() as progress:
        progress(0.0, "reading")
        mesh = in_unit(with_markers(read_mesh(name).mesh), units)
        progress(0.5, "markers")
        kinds, warnings = marker_kinds(mesh, patches), doubtful_kinds(mesh, patches)
        progress(0.7, "cells")
        quality, certificate = mesh.quality(), Certificate(certify_mixed(mesh))
        walls = [marker for marker, guess in kinds.items() if guess.kind == "wall"]
        spacings = mesh_wall_spacings(mesh, walls)
    numbers = {**_mesh_numbers(mesh, kinds, quality, spacings, reynolds, units), **_proved(certificate)}
    with written_json(json, numbers):
        if draft:
            with replaced_file(draft) as part:
                part.write_text(draft_kinds(mesh, kinds), encoding="utf-8")
    _show_mesh(mesh, kinds, numbers, certificate)
    if walls and not numbers["to_declare"]:
        print_lines([f"walls that can move: {', '.join(walls)}"])
    if draft:
        print_lines([f"{draft} written: mend the kinds of markers, then pass it as --patches {draft}"])
    if numbers["to_declare"]:
        warnings.append(numbers["to_declare"])
    print_warnings(warnings)


def measure_mesh(
    name: str,  # the file
    json: Path | None,  # numbers to write
    patches: Path | None,  # declared kinds of its markers
    baseline: str | None,  # the mesh before the move, or its model
    units: str | None,  # unit of lengths
) -> None:
    """Measure the cells and faces of a mesh and show the results."""
    check_outputs([json], [name, patches, baseline])
    with progress_bar() as progress:
        progress(0.0, "reading")
        mesh = in_unit(with_markers(read_mesh(name).mesh), units)
        before, known = (mesh, {}) if baseline is None else _baseline_of(baseline, mesh, name)
        kinds = known if known and patches is None else marker_kinds(before, patches)
        progress(0.5, "cells")
        quality = mesh_quality(before, mesh.points)
        certificate = Certificate(certify_mixed(before, mesh.points))
        newly = quality.is_inverted & ~before.quality().is_inverted if baseline else np.zeros(0, dtype=bool)
        walls = {marker: faces for marker, faces in (before.markers or {}).items() if kinds[marker].kind == "wall"}
        heights = {marker: _heights(before, faces, mesh.points, baseline) for marker, faces in walls.items()}
        sides = find_periodic_sides(before, {marker: guess.kind for marker, guess in kinds.items()})
        periodic = side_numbers(sides, before, mesh.points if baseline else None)
    numbers = {**_quality_numbers(name, baseline, before, quality, newly, heights), **_proved(certificate)}
    numbers["periodic"] = periodic
    with written_json(json, numbers):
        pass
    _show_quality(name, before, numbers, baseline)
    print_lines(gap_lines(periodic, before.length_unit))
    _show_proved(certificate, before)


def _proved(certificate: Certificate) -> dict:
    """What is proved about single cells, for JSON; None if no cell has a map."""
    return {"certificate": certificate_numbers(certificate) if certificate.cells else None}


def _show_proved(certificate: Certificate, mesh: MixedMesh) -> None:
    """Print what is proved about single cells."""
    if certificate.cells:
        show_certificate(certificate)
    print_lines(unproved_lines(mesh))


def _baseline_of(baseline: str, mesh: MixedMesh, name: str) -> tuple[MixedMesh, dict[str, MarkerGuess]]:
    """The mesh before the move, from its own file or its model, and the kinds of its markers if that knows them."""
    model = MeshModel.load(baseline) if Path(baseline).suffix == MODEL else None
    before = model.mesh if model else with_markers(read_mesh(baseline).mesh)
    before = replace(before, unit=mesh.unit or before.unit)
    kinds = {name: MarkerGuess(kind, "sure", f"in {baseline}") for name, kind in model.kinds.items()} if model else {}
    if (before.n_points, before.cell_counts) != (mesh.n_points, mesh.cell_counts):
        raise InputError(
            f"{name}: has {mesh.n_stored:,} nodes and {mesh.n_cells:,} cells, the baseline {baseline} "
            f"{before.n_stored:,} and {before.n_cells:,}; give the mesh that was moved"
        )
    return before, kinds


def _heights(
    before: MixedMesh, faces: np.ndarray, points: np.ndarray, baseline: str | None
) -> dict[str, dict[str, float]]:
    """Quantiles of the heights at a wall, and of their ratios to the baseline."""
    first = NodeHeights.of(before, before.into_fluid(faces))
    found = {"heights": height_quantiles(first.heights(points))}
    if baseline is not None:
        found["ratios"] = height_quantiles(first.ratios(points))
    return found


def _inverted(mesh: MixedMesh, which: np.ndarray, volumes: np.ndarray, middles: np.ndarray) -> list[dict]:
    """Collect name, volume and place of inverted cells, the smallest volumes first."""
    cells = np.flatnonzero(which)
    cells = cells[np.argsort(volumes[cells], kind="stable")][:MOST_NUMBERED]
    return [
        {"cell": mesh.cell_name(cell), "volume": volumes[cell], "place": middles[cell].tolist()}
        for cell in cells.tolist()
    ]


def n_unmarked_faces(mesh: MixedMesh) -> int:
    """Boundary faces without a marker; faces in the planes of a two-dimensional file do not count."""
    skin = mesh.skin
    if mesh.n_copies == 2:
        is_upper = skin >= mesh.n_stored
        skin = skin[is_upper.any(axis=1) & ~is_upper.all(axis=1)]
    marked = [face_keys(faces, mesh.n_points) for faces in (mesh.markers or {}).values()]
    return int((~np.isin(face_keys(skin, mesh.n_points), np.concatenate([np.zeros(0), *marked]))).sum())


def unmarked_lines(n_faces: int) -> list[str]:
    """Say what happens to boundary faces without a marker."""
    found = counted(n_faces, "face")
    said = f"{found} of the boundary have no marker, and move along: only nodes of markers are fixed"
    return [said] if n_faces else []


def n_unused_nodes(mesh: MixedMesh) -> int:
    """Nodes of the file that are in no cell, such as centres of arcs that Gmsh writes."""
    is_used = np.zeros(mesh.n_points, dtype=bool)
    is_used[mesh.cell_faces[0]] = True
    return int(np.count_nonzero(~is_used[: mesh.n_stored]))


def unused_lines(n_nodes: int) -> list[str]:
    """Say what happens to nodes that are in no cell."""
    said = f"{counted(n_nodes, 'node')} in no cell: kept in the file, moved along, and counted in the size of the mesh"
    return [said] if n_nodes else []


def _mesh_numbers(
    mesh: MixedMesh,
    kinds: Mapping[str, MarkerGuess],
    quality: CellQuality,
    spacings: tuple[WallSpacing, ...],
    reynolds: float | None,
    units: str | None,
) -> dict:
    """Collect the numbers of a mesh for JSON."""
    nodes, markers = mesh.points[: mesh.n_stored], mesh.markers or {}
    return {
        "mesh": mesh.source,
        "units": units,
        "dimensions": 2 if mesh.n_copies == 2 else 3,
        "n_nodes": mesh.n_stored,
        "n_cells": mesh.n_cells,
        "cells": mesh.cell_counts,
        "box": {"low": nodes.min(axis=0).tolist(), "high": nodes.max(axis=0).tolist()} if len(nodes) else None,
        "min_volume": quality.volumes.min() if len(quality.volumes) else None,
        "n_inverted": int(quality.is_inverted.sum()),
        "markers": [
            {
                "name": name,
                "kind": guess.kind,
                "n_faces": len(markers[name]),
                "sureness": guess.sure,
                "reason": guess.why,
            }
            for name, guess in kinds.items()
        ],
        "n_unmarked_faces": n_unmarked_faces(mesh),
        "n_unused_nodes": n_unused_nodes(mesh),
        "walls": [
            {**numbers, "quantiles": height_quantiles(NodeHeights.of(mesh, mesh.into_fluid(markers[s.patch])).baseline)}
            for numbers, s in zip(spacing_numbers(spacings, reynolds), spacings)
        ],
        "to_declare": undecided(mesh, kinds) or None,
    }


def _show_mesh(mesh: MixedMesh, kinds: Mapping[str, MarkerGuess], numbers: dict, certificate: Certificate) -> None:
    """Print the contents of a mesh."""
    said = f", unit of length: {numbers['units']}" if numbers["units"] else ""
    print_title(
        f"{mesh.source}: {counted(mesh.n_stored, 'node')}, {counted(mesh.n_cells, 'cell')}, {numbers['dimensions']} "
        f"dimensions{said}"
    )
    print_table(["cells", "number"], list(numbers["cells"].items()))
    if kinds:
        rows = [(m["name"], m["kind"], m["n_faces"], m["sureness"], m["reason"]) for m in numbers["markers"]]
        print_table(["marker", "kind", "faces", "how sure", "why"], rows)
    lines = []
    if numbers["box"]:
        low, high = (", ".join(f"{x:.4g}" for x in numbers["box"][end]) for end in ("low", "high"))
        lines.append(f"from ({low}) to ({high})")
    if numbers["min_volume"] is not None:
        what, unit = measure_of_cells(mesh)
        least = f"smallest {what} {numbers['min_volume']:.4g} {unit}"
        lines.append(f"{least}, {counted(numbers['n_inverted'], 'inverted cell')}")
    print_lines([*lines, *unmarked_lines(numbers["n_unmarked_faces"]), *unused_lines(numbers["n_unused_nodes"])])
    _show_proved(certificate, mesh)
    walls = numbers["walls"]
    if walls:
        columns = ["first nodes above", f"min ({mesh.length_unit})", "1 %", "median", "99 %", "max", "aspect"]
        measures = [[*wall["quantiles"].values(), wall["aspect_median"]] for wall in walls]
        if "y_plus" in walls[0]:
            columns.append("y+")
            measures = [[*found, wall["y_plus"]] for found, wall in zip(measures, walls)]
        print_table(columns, [(wall["patch"], *map(_short, found)) for wall, found in zip(walls, measures)])


def _short(number: float) -> str:
    return f"{number:.3g}"


def _quality_numbers(
    name: str,
    baseline: str | None,
    mesh: MixedMesh,
    quality: MeshQuality,
    newly: np.ndarray,
    heights: Mapping[str, dict[str, dict[str, float]]],
) -> dict:
    """Collect the numbers of cells and faces for JSON."""
    return {
        "mesh": name,
        "baseline": baseline,
        "n_cells": mesh.n_cells,
        "cells": mesh.cell_counts,
        "min_volume": quality.volumes.min() if len(quality.volumes) else None,
        "volume": float(quality.volumes.sum()),
        "n_inverted": int(quality.is_inverted.sum()),
        "inverted": _inverted(mesh, quality.is_inverted, quality.volumes, quality.middles),
        "newly_inverted": _inverted(mesh, newly, quality.volumes, quality.middles) if baseline else None,
        "non_orthogonality": {
            "max": quality.angles.max(initial=0.0),
            "average": quality.mean_angle,
            "n_severe": quality.n_severe,
            "n_beyond": quality.n_beyond,
        },
        "orientation": {"n_faces": quality.n_wrong_faces, "n_pyramids": quality.n_wrong_pyramids},
        "skewness": {
            "max": quality.skewness.max(initial=0.0),
            "average": quality.skewness.mean() if len(quality.skewness) else 0.0,
            "n_skewed": quality.n_skewed,
        },
        "heights": [{"marker": marker, **found} for marker, found in heights.items()],
    }


def _show_quality(name: str, mesh: MixedMesh, numbers: dict, baseline: str | None) -> None:
    """Print the measures of cells and faces, and the inverted cells."""
    kinds = ", ".join(f"{n:,} {kind}" for kind, n in numbers["cells"].items())
    print_title(f"{name}: {counted(numbers['n_cells'], 'cell')} ({kinds})")
    angle, skewness = numbers["non_orthogonality"], numbers["skewness"]
    smallest, (what, unit) = numbers["min_volume"], measure_of_cells(mesh)
    print_table(
        ["measure", "value"],
        [
            (f"smallest {what} ({unit})", "-" if smallest is None else f"{smallest:.4g}"),
            ("inverted cells", f"{numbers['n_inverted']:,}"),
            ("largest non-orthogonality (deg)", f"{angle['max']:.4g}"),
            ("average non-orthogonality (deg)", f"{angle['average']:.4g}"),
            (f"faces above {SEVERE:g} deg, up to {BEYOND:g}", f"{angle['n_severe']:,}"),
            (f"faces above {BEYOND:g} deg", f"{angle['n_beyond']:,}"),
            ("faces oriented wrongly", f"{numbers['orientation']['n_faces']:,}"),
            ("largest skewness", f"{skewness['max']:.4g}"),
            ("average skewness", f"{skewness['average']:.4g}"),
            (f"faces of skewness above {SKEWED:g}", f"{skewness['n_skewed']:,}"),
        ],
    )
    columns = (
        ("heights", "first nodes above", f"min ({mesh.length_unit})"),
        ("ratios", "heights relative to the baseline at", "min"),
    )
    for key, title, minimum in columns:
        rows = [(wall["marker"], *map(_short, wall[key].values())) for wall in numbers["heights"] if wall.get(key)]
        if rows:
            print_table([title, minimum, "1 %", "median", "99 %", "max"], rows)
    if baseline is not None:
        print_lines(
            [f"{_where(c)}: was valid on the baseline" for c in numbers["newly_inverted"][:MOST_LISTED]], "yellow"
        )
    inverted = numbers["inverted"][:MOST_LISTED]
    print_lines([f"{_where(c)}: is inverted, {what} {c['volume']:.3g} {unit}" for c in inverted])


def _where(cell: dict) -> str:
    return f"{cell['cell']} around ({', '.join(f'{x:.4g}' for x in cell['place'])})"
