"""The command ``seams``: smoothness of the walls of a model across the seams between its blocks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...core.design.named_deformations import parse_deformation
from ...core.measures.seams import PoleContinuity, SeamContinuity, pole_continuity, seam_continuity
from ...core.mesh.boundary import moving_mesh
from ...core.model.fitted_model import FittedModel
from .output import check_outputs, print_lines, print_table, print_title, written_json

MOST_LISTED = 10
"""Number of seams and poles to print, those with the largest kinks."""


def measure_seams(
    model_file: Path,  # fitted model
    patch: tuple[str, ...],  # patches by name or pattern; all walls if empty
    # deformations of the walls, after which seams are measured; which are smooth is decided before
    deform: tuple[str, ...],
    max_kink: float,  # largest kink (deg) at which a seam counts as smooth
    mirror: bool,  # include edges in planes of symmetry, where the surface meets its mirror image
    json: Path | None,  # numbers to write
) -> None:
    """Measure kinks and curvatures across the seams of a model, and the flatness of its poles."""
    check_outputs([json], [model_file, *(Path(text) for text in deform if Path(text).is_file())])
    with progress_bar() as progress:
        progress(0.0, "reading")
        model = FittedModel.load(model_file)
        progress(0.4, "seams")
        patches = patch or None
        before = {seam.number: seam.max_kink for seam in seam_continuity(model, None, patches, mirror=mirror)}
        points = _deformed(model, deform)
        seams = seam_continuity(model, points, patches, mirror=mirror)
        poles = pole_continuity(model, points, patches)
    smooth = [seam for seam in seams if before[seam.number] <= max_kink]
    numbers = {
        "model": str(model_file),
        "seams": [_seam_numbers(seam, before[seam.number], max_kink) for seam in seams],
        "poles": [{"names": pole.names, "point": pole.point.tolist(), "kink": pole.kink} for pole in poles],
        "n_smooth": len(smooth),
        "kink": max((seam.max_kink for seam in smooth), default=0.0),
        "curvature_jump": max((seam.max_jump for seam in smooth), default=0.0),
    }
    with written_json(json, numbers):
        pass
    show_seams(str(model_file), seams, smooth, poles, max_kink, before if deform else None)


def _deformed(model: FittedModel, deform: tuple[str, ...]) -> np.ndarray:
    """Control points of a model with a deformed surface; control points inside the volumes stay."""
    points = model.control_points.copy()
    if deform:
        mesh = moving_mesh(model)
        points[mesh.surface_ids] = parse_deformation(deform, model, mesh).apply(points[mesh.surface_ids])
    return points


def _seam_numbers(seam: SeamContinuity, before: float, max_kink: float) -> dict:
    """Collect the numbers of a seam for JSON."""
    return {
        "names": seam.names,
        "kink": seam.max_kink,
        "kink_before": before,
        "is_smooth": bool(before <= max_kink),
        "curvature_jump": seam.max_jump,
        "places": seam.points.tolist(),
        "kinks": seam.kinks.tolist(),
        "curvatures": seam.curvatures.tolist(),
    }


def show_seams(
    name: str,
    seams: Sequence[SeamContinuity],
    smooth: Sequence[SeamContinuity],
    poles: Sequence[PoleContinuity],
    max_kink: float,
    before: dict[int, float] | None,
) -> None:
    """Print the seams with the largest kinks, smooth seams and edges separately, and the poles."""
    print_title(f"{name}: {counted(len(seams), 'seam')}, {counted(len(poles), 'pole')}")
    edges = [seam for seam in seams if not any(seam is other for other in smooth)]
    for what, chosen in (("smooth seam", smooth), ("edge", edges)):
        rows = [_row(seam, before) for seam in chosen[:MOST_LISTED]]
        was = ["before"] if before is not None else []
        if rows:
            print_table([what, "kink (deg)", *was, "around (m)", "jump (1/m)"], rows)
    if poles:
        listed = [(_sides(pole.names), f"{pole.kink:.3g}", _place(pole.point)) for pole in poles[:MOST_LISTED]]
        print_table(["pole of", "kink (deg)", "at (m)"], listed)
    lines = []
    if smooth:
        kink, jump = max(seam.max_kink for seam in smooth), max(seam.max_jump for seam in smooth)
        now = "" if before is None else " before, now"
        lines.append(
            f"{counted(len(smooth), 'seam')} smooth to {max_kink:g} deg{now}: kinks up to {kink:.3g} deg, jumps of "
            f"curvature up to {jump:.3g} / m"
        )
    if edges:
        lines.append(f"{counted(len(edges), 'seam')} with kinks of more than {max_kink:g} deg: edges of the surface")
    print_lines(lines)


def _row(seam: SeamContinuity, before: dict[int, float] | None) -> tuple:
    """One row of a seam: its sides, kink, kink before, place of the largest kink, and the jump of curvature."""
    was = () if before is None else (f"{before[seam.number]:.3g}",)
    place = _place(seam.points[np.argmax(seam.kinks)]) if len(seam.kinks) else "-"
    return (_sides(seam.names), f"{seam.max_kink:.3g}", *was, place, f"{seam.max_jump:.3g}")


def _sides(names: Sequence[str]) -> str:
    """Blocks and sides that meet, without the patches."""
    return " | ".join(name.split(", ")[0].removeprefix("block ") for name in names)


def _place(point: np.ndarray) -> str:
    return ", ".join(f"{x:.3g}" for x in point)
