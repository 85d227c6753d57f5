"""Quality of the cells of an unstructured mesh on the page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.background.mesh_model import MeshModel
from ...core.evaluation.spline_validity import certify_splines
from ...grids.cells.mesh_quality import SEVERE, SKEWED, MeshQuality, mesh_quality
from ...grids.cells.mixed_quality import MixedQuality
from .charts import Chart, distribution_chart
from .shape import Shape
from .subject import Judgement, Mark
from .tables import Table, number

__all__ = ["judge"]

MOST_WORST = 10
"""Number of worst cells that are named."""

N_BINS = 50
"""Bins of distributions."""


def judge(model: MeshModel, quality: MixedQuality, shapes: Sequence[Shape]) -> Judgement:
    """Judge the cells of shapes of a mesh, the first of which is the baseline."""
    found = [mesh_quality(model.mesh, shape.nodes) for shape in shapes]
    ratios = quality.cell_ratios(shapes[-1].nodes) if len(shapes) > 1 else None
    last = found[-1]
    inverted = f"{int(last.is_inverted.sum()):,} of {model.mesh.n_cells:,} cells inverted"
    charts, tables = [_angle_chart(shapes, found)], [_quality_table(model, shapes, found, ratios)]
    most_skewed = np.argsort(-found[0].cell_angles, kind="stable")[:MOST_WORST]
    marks = [_marks(model, found[0], most_skewed, "non-orthogonality", found[0].cell_angles, "°")]
    if ratios is None:
        card = "largest non-orthogonality", f"{number(last.angles.max(initial=0.0), 3)}°", inverted
        tables.append(_worst_table(model, quality, shapes[0], last, most_skewed, None))
    else:
        order = np.argsort(ratios, kind="stable")[:MOST_WORST]
        card = "smallest pyramid, relative to before", number(ratios.min(initial=np.inf), 3), inverted
        charts.append(_ratio_chart(shapes[-1], ratios))
        tables.append(_worst_table(model, quality, shapes[-1], last, order, ratios))
        marks.append(_marks(model, last, order, "smallest pyramid relative to before", ratios, ""))
    return Judgement(card, marks, charts, tables)


def _angle_chart(shapes: Sequence[Shape], found: Sequence[MeshQuality]) -> Chart:
    """Distribution of the non-orthogonality of inner faces."""
    largest = max(float(each.angles.max(initial=0.0)) for each in found)
    edges = np.linspace(0.0, max(largest, 1.0), N_BINS + 1)
    percents = [100.0 * np.histogram(each.angles, edges)[0] / max(1, len(each.angles)) for each in found]
    title, last = "Non-orthogonality of faces", found[-1]
    text = (
        f"Distribution of the non-orthogonality of inner faces: largest {last.angles.max(initial=0.0):.3g} degrees, "
        f"average {last.mean_angle:.3g}, {last.n_severe:,} above {SEVERE:g}."
    )
    axis = {"title": {"text": "non-orthogonality (°)"}, "range": [0.0, edges[-1]]}
    return distribution_chart("quality", title, text, shapes, edges, percents, axis, "% of the inner faces")


def _ratio_chart(shape: Shape, ratios: np.ndarray) -> Chart:
    """Distribution of each cell's smallest pyramid relative to the baseline."""
    counted = ratios[np.isfinite(ratios)]
    low, high = (float(counted.min()), float(counted.max())) if len(counted) else (0.0, 1.0)
    edges = np.linspace(min(low, 0.99), max(high, 1.0), N_BINS + 1)
    percents = [100.0 * np.histogram(counted, edges)[0] / max(1, len(counted))]
    title = "Smallest pyramid of each cell, relative to before"
    text = f"{title}: from {low:.3g} to {high:.3g}; a cell is inverted where it is not positive."
    axis = {"title": {"text": "volume of the smallest pyramid, relative to before"}}
    layout = {"yaxis": {"type": "log", "title": {"text": "% of the cells"}}}
    chart = distribution_chart("ratios", title, text, [shape], edges, percents, axis, "% of the cells")
    chart.layout["yaxis"] = layout["yaxis"]
    return chart


def _quality_table(
    model: MeshModel, shapes: Sequence[Shape], found: Sequence[MeshQuality], ratios: np.ndarray | None
) -> Table:
    """Extremes of faces and cells."""
    unit = model.mesh.length_unit
    what = f"smallest volume ({unit}³)" if model.mesh.n_copies == 1 else f"smallest area ({unit}²)"
    n_cells = model.mesh.n_cells
    rows = [
        (what, [number(float(q.volumes.min(initial=np.inf)) / model.mesh.width) for q in found]),
        ("inverted cells", [f"{int(q.is_inverted.sum()):,} of {n_cells:,}" for q in found]),
        ("largest non-orthogonality (°)", [number(q.angles.max(initial=0.0)) for q in found]),
        ("average non-orthogonality (°)", [number(q.mean_angle) for q in found]),
        (f"faces above {SEVERE:g}°", [f"{q.n_severe:,} of {len(q.angles):,}" for q in found]),
        ("largest skewness", [number(q.skewness.max(initial=0.0)) for q in found]),
        (f"faces of skewness above {SKEWED:g}", [f"{q.n_skewed:,} of {len(q.skewness):,}" for q in found]),
        ("elements of the lattice", [_certificate(model, shape) for shape in shapes]),
    ]
    if ratios is not None:
        rows.insert(2, ("smallest pyramid, relative to before", ["1", number(ratios.min(initial=np.inf))]))
    note = (
        "Non-orthogonality and skewness of faces as OpenFOAM's checkMesh defines them; pyramids are between the "
        "centre of a cell and its faces: a cell is inverted where one of them is not positive. Elements of the lattice "
        "are valid where its map is proved to have a positive Jacobian everywhere; around an axis it is no such map."
    )
    return Table("Quality of the cells", ("measure", *(s.label for s in shapes)), [(n, *v) for n, v in rows], note)


def _certificate(model: MeshModel, shape: Shape) -> str:
    """What is proved about the lattice."""
    if shape.control_points is None or not model.lattice.frame.is_cartesian:
        return "–"
    mesh, points = model.splines_at(shape.control_points)
    (found,) = certify_splines(mesh, points, model.spline_names, model.splines_at(model.control_points)[1])
    others = [f"{n:,} {word}" for n, word in ((found.n_invalid, "invalid"), (found.n_undecided, "undecided")) if n]
    return f"all {found.n:,} valid" if not others else f"{', '.join(others)} of {found.n:,}"


def _worst_table(
    model: MeshModel,
    quality: MixedQuality,
    shape: Shape,
    found: MeshQuality,
    order: np.ndarray,
    ratios: np.ndarray | None,
) -> Table:
    """The worst cells and their places."""
    rows, width = [], model.mesh.width
    for cell in order.tolist():
        place = found.middles[cell]
        ratio = [] if ratios is None else [number(ratios[cell], 3)]
        at = ", ".join(number(x, 4) for x in place)
        measures = number(found.cell_angles[cell], 3), number(found.volumes[cell] / width, 3)
        rows.append((model.mesh.cell_name(cell), *ratio, *measures, at, quality.marker_at(place) or "–"))
    unit = model.mesh.length_unit
    size = f"volume ({unit}³)" if model.mesh.n_copies == 1 else f"area ({unit}²)"
    columns = ("cell", *([] if ratios is None else ["smallest pyramid relative to before"]))
    by = "the largest non-orthogonality" if ratios is None else "the smallest pyramids relative to before"
    return Table(
        f"Worst cells: {shape.label.lower()}",
        (*columns, "non-orthogonality (°)", size, f"place x, y, z ({unit})", "nearest marker"),
        rows,
        f"The cells with {by}; numbers are from 1, separately for each kind.",
    )


def _marks(
    model: MeshModel, found: MeshQuality, cells: np.ndarray, what: str, values: np.ndarray, unit: str
) -> list[Mark]:
    """Marks of some cells."""
    return [
        Mark(found.middles[cell].tolist(), f"{model.mesh.cell_name(cell)}<br>{what} {values[cell]:.3g}{unit}")
        for cell in cells.tolist()
    ]
