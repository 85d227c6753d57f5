"""The command ``report``: a page on a model or an optimisation."""

from __future__ import annotations

from pathlib import Path

from ...base.numerics.progress import progress_bar
from ..report.page import write_report
from .output import check_outputs, print_lines, print_title, print_warnings, written_json


def report_on(
    source: Path,  # model or case file
    output: Path,  # page to write
    model: Path | None,  # the model of a case file
    title: str | None,  # heading of the page
    triangles: int,  # triangles of the walls that are drawn of each shape
    json: Path | None,  # numbers to write
) -> None:
    """Write a page on a model or a case file, see `write_report`."""
    check_outputs([output, json], [source, model])
    with progress_bar() as progress:
        progress(0.0, "reading and drawing")
        numbers = write_report(output, source, model, title=title, most_triangles=triangles)
        progress(1.0, "written")
    with written_json(json, {"source": str(source), **numbers}):
        pass
    print_title(f"{output}: {numbers['bytes'] / 1e6:.1f} MB, needs no network")
    if numbers["triangles"] < numbers["triangles_of_walls"]:
        drawn, walls = numbers["triangles"], numbers["triangles_of_walls"]
        print_lines([f"{drawn:,} of {walls:,} triangles of the walls are drawn"])
    print_warnings([*numbers["notes"], *(f"not shown: {text}" for text in numbers["missing"])])
    print_lines([f"{output} written"])
