"""The command ``cad``: walls of a model as a STEP or IGES file."""

from __future__ import annotations

from pathlib import Path

from ...base.numerics.progress import progress_bar
from ...base.text import counted
from ...core.cad.files import check_cad_name
from ...core.cad.opencascade import require_opencascade
from ...core.cad.write_cad import CadReport, write_cad
from ...core.model.fitted_model import FittedModel
from .output import (
    check_outputs,
    counts_text,
    print_lines,
    print_table,
    print_title,
    print_warnings,
    written_json,
)


def write_cad_file(
    model: Path,  # fitted model
    output: Path,  # output, json: CAD file and numbers to write
    tolerance: float | None,  # largest distance (m) from the walls if they are refitted
    units: str,  # unit of length of the file
    patch: tuple[str, ...],  # patches by name or pattern; all walls if empty
    json: Path | None,
) -> None:
    """Write the walls of a model as B-spline surfaces."""
    check_outputs([output, json], [model])
    check_cad_name(output, units)
    require_opencascade()
    with progress_bar() as progress:
        progress(0.0, "reading")
        fitted = FittedModel.load(model)
        progress(0.2, "surfaces")
        report = write_cad(output, fitted, patches=patch or None, tolerance=tolerance, units=units)
        with written_json(json, {"model": str(model), "units": units, **cad_numbers(report)}):
            pass
    print_title(f"{output}: {counted(len(report.faces), 'face')} of {model}")
    rows = [
        (face.name, f"{counts_text(face.n_control[0])} -> {counts_text(face.n_control[1])}", face.error, face.angle)
        for face in report.faces
    ]
    print_table(["face", "control points", "off (m)", "(deg)"], rows)
    show_cad(report)


def cad_numbers(report: CadReport) -> dict:
    """Collect the numbers of a CAD file for JSON."""
    return {
        **vars(report),
        "faces": [vars(face) for face in report.faces],
        "error": report.error,
        "n_exact": report.n_exact,
        "is_closed": report.is_closed,
    }


def show_cad(report: CadReport) -> None:
    """Print what was written, and the result of reading it back."""
    n, n_open = len(report.faces), report.n_open - report.n_on_symmetry
    exact = f"{report.n_exact} of {counted(n, 'face')} exact"
    refitted = "" if report.n_exact == n else f", the others refitted to {report.tolerance:.2g} m"
    edges = f"{counted(report.n_on_symmetry, 'edge')} on planes of symmetry open, {n_open} elsewhere"
    closed = f"{counted(report.n_solids, 'solid')}, no open edge" if not report.n_open else edges
    print_lines(
        [
            f"{exact}{refitted}; read back by OpenCascade: {'valid' if report.is_valid else 'NOT valid'}, {closed}, "
            f"walls within {report.distance:.2g} m of it"
        ]
    )
    if report.missed is not None:
        print_lines([f"the fit misses wall nodes of the grid by up to {report.missed:.2g} m, which is not in the file"])
    warnings = []
    if not report.is_valid:
        warnings.append("OpenCascade finds faults in what it reads back; try a larger --tolerance")
    if n_open:
        warnings.append(
            f"{counted(n_open, 'edge')} open away from planes of symmetry: the patches leave out a part of "
            f"the surface, or blocks do not share an edge there; see 'bspline-mdao inspect'"
        )
    print_warnings(warnings)
    print_lines([f"{report.path} written, {report.n_bytes / 1e3:,.0f} kB"])
