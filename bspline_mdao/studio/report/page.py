"""The report page: one HTML file that needs no network."""

from __future__ import annotations

import datetime
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import openmdao.api as om

from ... import __version__
from ...core.background.load_model import load_model
from ...core.model.movable import Movable
from ...core.om.drivers.case_history import CaseHistory, read_history
from ...core.om.drivers.sound_cases import sound_cases
from ...core.om.model_option import named_model
from ...core.sliding.sliding_nodes import Slide
from ...errors import InputError
from ...flow.euler.error_estimate import ErrorEstimate
from ...flow.om.induced_gain import induced_gains
from ...grids.io.disk import replaced_file
from ...grids.io.formats import MODEL
from ..plotting.figures import require
from . import block_subject, mesh_subject  # noqa: F401 - each registers its subject
from .charts import Chart, height_chart, history_charts, lattice_charts, pressure_chart, section_chart
from .contents import Contents, axes_of, shapes_of
from .model_file import find_model
from .notes import notes_on
from .shape import Axes, Shape
from .space import DRAWN, camera, space_traces
from .subject import Subject, subject_of
from .tables import (
    Table,
    estimate_table,
    flow_table,
    height_table,
    history_table,
    interface_table,
    number,
    variable_table,
)
from .walls import Walls

__all__ = ["MOST_TRIANGLES", "Section", "write_report"]

EXTRA = "report"
"""Command that installs the libraries for pages."""

CASES = "cases.sql"
"""Case file in the folder that the command ``optimize`` writes."""

NO_MODEL = "The grid is not shown: each process has only a part of it."
"""What is missing if a problem has only local models."""

MOST_TRIANGLES = 40_000
"""Triangles of the walls drawn for each shape: as many as a phone turns smoothly."""


@dataclass(frozen=True)
class Section:
    """A section of the page."""

    key: str  # name in links
    title: str  # heading
    lines: Sequence[str] = ()  # paragraphs
    charts: Sequence[Chart] = ()
    tables: Sequence[Table] = ()
    kind: str = ""  # ``"space"`` and ``"diagram"`` add the contents of the sections of these names


def write_report(
    path: str | os.PathLike,
    source: Any,
    model: Movable | str | os.PathLike | None = None,
    *,
    title: str | None = None,
    estimates: Mapping[str, ErrorEstimate] | None = None,
    baseline: Mapping[str, ErrorEstimate] | None = None,
    slides: Sequence[Slide] = (),
    most_triangles: int = MOST_TRIANGLES,
) -> dict[str, Any]:
    """Write a report on a model, or on an optimisation, as one HTML file that needs no network.

    The page shows the walls and the control mesh in 3D, the quality of the cells and the worst cells, and heights at
    walls. For an optimisation it shows the histories of objective, constraints and first-order optimality, the
    variables with their bounds, sections and pressures before and after, and the N2 diagram. The page names what cannot
    be shown.

    Parameters
    ----------
    path : path-like
        The page, ``something.html``, replaced when the new one is complete.
    source : FittedModel, MeshModel or path-like
        A model, its file ``MODEL.h5``, a case file ``case.sql`` of a driver's ``om.SqliteRecorder``, or the folder that
        the command ``optimize`` wrote. Shapes and pressures are shown if ``control_points`` (or ``grid``) and ``Cp``
        are recorded, optimality if derivatives are.
    model : FittedModel, MeshModel or path-like, optional
        The model that was optimised, for a case file; by default the file that the case file names, or a file next to
        it with the same checksum.
    title : str, optional
        Heading of the page; by default the name of the source.
    estimates : mapping of str to ErrorEstimate, optional
        Estimates of lift and drag at the end of an optimisation on a finer grid: ``estimates`` of `design_summary`.
    baseline : mapping of str to ErrorEstimate, optional
        The same for the baseline: the page then gives the reduction of induced drag on either grid.
    slides : sequence of Slide
        Patches of a fitted grid that slide on surfaces, ``mesh.slides`` of the mesh that moved: nodes are shown there,
        and the page gives their distances from the surfaces.
    most_triangles : int
        Approximate number of wall triangles drawn for each shape; of larger grids every n-th line is drawn.

    Returns
    -------
    dict
        ``report``, ``bytes``, ``triangles`` drawn and ``triangles_of_walls``, ``missing``, what the page cannot show,
        and ``notes``, its remarks on infeasible designs and on Mach numbers without a comparison.

    Raises
    ------
    InputError
        If a file cannot be read or written, the case file belongs to another model, or plotly or jinja2 is missing.

    Examples
    --------
    >>> from bspline_mdao import fit_grid, write_report
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> model = fit_grid(onera_m6_grid((5, 5, 5)))
    >>> write_report("m6.html", model)["missing"]  # doctest: +SKIP
    []
    """
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{path}: a report is an HTML file; give a name that ends in .html")
    if most_triangles < 100:
        raise InputError(f"most_triangles: {most_triangles} are too few to see a wall; give 100 or more")
    require("plotly.graph_objects", EXTRA), require("jinja2", EXTRA)
    gains = tuple(gain.warning or gain.words for gain in induced_gains(baseline or {}, estimates or {}))
    contents = replace(_contents(source, model, title, slides), estimates=estimates or {}, gains=gains)
    return write_contents(path, contents, most_triangles)


def _contents(
    source: Any, model: Movable | str | os.PathLike | None, title: str | None, slides: Sequence[Slide]
) -> Contents:
    """The contents of a report on a source."""
    if isinstance(source, Movable):
        return of_model(source, title, slides)
    if Path(source).suffix == MODEL:
        if model is not None:
            raise InputError(f"{source}: is a model already; leave out the other one")
        return of_model(load_model(source), title or Path(source).name, slides)
    source = Path(source) / CASES if Path(source).is_dir() else source
    history = read_history(source)
    diagram, missing = _diagram(source)
    contents = Contents(title or Path(source).name, history=history, missing=missing, diagram=diagram)
    if model is None:
        model, reason = find_model(Path(source), named_model(history.options))
        if model is None:
            return contents.without(reason)
    return with_model(contents, model if isinstance(model, Movable) else load_model(model), slides)


def of_model(model: Movable, title: str | None, slides: Sequence[Slide] = ()) -> Contents:
    """The contents of a report on a model only."""
    return with_model(Contents(title or model.source), model, slides)


def with_model(contents: Contents, model: Movable, slides: Sequence[Slide] = ()) -> Contents:
    """Add the shapes of a model to the contents."""
    if model.ownership is not None:
        return contents.without(NO_MODEL)
    subject = subject_of(model, slides)
    shapes, missing = shapes_of(subject, contents.history)
    history = contents.history and contents.history.in_length_unit(subject.unit)
    return replace(contents.without(*missing), subject=subject, shapes=shapes, history=history)


def write_contents(path: str | os.PathLike, contents: Contents, most_triangles: int = MOST_TRIANGLES) -> dict[str, Any]:
    """Write a page, see `write_report`."""
    graph_objects, jinja2 = require("plotly.graph_objects", EXTRA), require("jinja2", EXTRA)
    markup = require("markupsafe", EXTRA).Markup
    sections, space, numbers = _sections(contents, most_triangles)
    charts = {chart.key: _json(graph_objects, chart.data, chart.layout) for s in sections for chart in s.charts}
    if space is not None:
        charts["space"] = _json(graph_objects, *space)
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    template = environment.from_string(files(__package__).joinpath("page.html").read_text(encoding="utf-8"))
    text = template.render(
        title=contents.title,
        subtitle=_subtitle(contents),
        cards=_cards(contents, numbers),
        sections=sections,
        charts={key: markup(_harmless(value)) for key, value in charts.items()},
        layers=numbers.get("layers", {}),
        drawn=DRAWN,
        space=numbers,
        shapes=[shape.label for shape in contents.shapes],
        diagram=None if contents.diagram is None else markup(_harmless(json.dumps(contents.diagram))),
        plotly=markup(require("plotly.offline", EXTRA).get_plotlyjs()),
        version=__version__,
        date=datetime.datetime.now().strftime("%Y-%m-%d %H:%M"),
    )
    with replaced_file(path) as file:
        file.write_text(text, encoding="utf-8")
    return {
        "report": str(path),
        "bytes": len(text.encode()),
        "triangles": numbers.get("triangles", 0),
        "triangles_of_walls": numbers.get("of_all", 0),
        "missing": list(contents.missing),
        "notes": notes_on(contents.history) if contents.history else [],
    }


def _sections(contents: Contents, most_triangles: int) -> tuple:
    """Sections of the page, the 3D view, and numbers about both."""
    sections: list[Section] = []
    space, numbers, of_grid = None, {}, []
    if contents.subject is not None:
        space, numbers, of_grid = _of_grid(contents, contents.subject, most_triangles)
        sections.append(of_grid.pop(0))
    if contents.history is not None:
        sections += _of_history(contents.history, contents)
    sections += of_grid
    if contents.diagram is not None:
        line = "The components of the problem and what is passed between them, as OpenMDAO draws it."
        sections.append(Section("diagram", "Model of the problem (N2)", [line], kind="diagram"))
    if contents.missing:
        sections.append(Section("missing", "Not shown", contents.missing))
    return sections, space, numbers


def _of_grid(contents: Contents, subject: Subject, most_triangles: int) -> tuple:
    """3D view, numbers about it, and sections on the shapes of a grid, the section with the view first."""
    shapes = contents.shapes
    judgement, walls = subject.judge(shapes), subject.walls(most_triangles)
    points = shapes[0].nodes[walls.rows]
    axes = axes_of(subject, points, contents.history.options if contents.history else {})
    traces, colors = space_traces(shapes, subject, axes, walls, judgement.marks)
    layers = {trace["meta"]["layer"] for trace in traces}
    titles = {f"{name}axis": {"title": {"text": f"{name} ({axes.unit})"}} for name in "xyz"}
    layout = {"scene": {"camera": camera(axes, points, "symmetry" in layers), "aspectmode": "data", **titles}}
    numbers = {
        "triangles": walls.n_triangles,
        "of_all": walls.n_of_all,
        "colors": colors,
        "layers": {key: name for key, name in subject.layers.items() if key in layers},
        "card": judgement.card,
    }
    sections = [Section("space", subject.space_title, [_drawn_text(walls)], kind="space")]
    if walls.are_walls:
        sections.append(_on_sections(subject, shapes, walls, axes))
    sections.append(Section("quality", "Quality of the cells", [], judgement.charts, judgement.tables))
    if subject.heights is not None:
        parts = [height_chart(shapes, subject.heights, axes.unit)], [height_table(shapes, subject.heights, axes.unit)]
        sections.append(Section("heights", "Wall heights", [], *parts))
    meeting = interface_table(shapes, subject.misses(shapes), axes.unit)
    if meeting is not None:
        sections.append(Section("interfaces", "Interfaces", [], [], [meeting]))
    key, title, tables = subject.contents
    sections.append(Section(key, title, [], [], tables))
    return (traces, layout), numbers, sections


def _drawn_text(walls: Walls) -> str:
    """Say how much of the walls is drawn."""
    what = "the walls" if walls.are_walls else "the boundary, since no patch is a wall"
    line = f"Drawn: {what}, with {walls.n_triangles:,} triangles"
    if walls.n_triangles < walls.n_of_all:
        return line + f" of {walls.n_of_all:,}: {walls.how_fewer}."
    return line + ", all that there are."


def _on_sections(subject: Subject, shapes: Sequence[Shape], walls: Walls, axes: Axes) -> Section:
    """Section on cuts of the walls."""
    charts = [section_chart(shapes, walls.quads(), axes), *subject.section_charts(shapes, walls, axes)]
    names, corners = dict.fromkeys(name for shape in shapes for name in shape.pressures), subject.pressure_faces
    if corners is not None:
        charts += [c for name in names if (c := pressure_chart(shapes, name, corners, axes)) is not None]
    guess = " The axes are guessed: no flow says which are downstream and along the span." if axes.is_guessed else ""
    title = "Sections and pressures" if names else "Sections"
    return Section("sections", title, [f"Cuts of the walls across the axis {'xyz'[axes.span]}.{guess}"], charts)


def _of_history(history: CaseHistory, contents: Contents) -> list[Section]:
    """Sections on an optimisation."""
    lines = [f"{history.n_evaluations} evaluations by {history.driver} in {_time_text(history.seconds[-1])}."]
    lines += [*contents.gains, *notes_on(history)]
    if history.n_others:
        lines.append(f"{history.n_others} evaluations before are not shown: they have other variables or responses.")
    if history.convergence is not None and not history.convergence.residuals.size:
        lines.append(
            "First-order optimality is not shown: derivatives are not recorded. "
            'Set problem.driver.recording_options["record_derivatives"] = True.'
        )
    variables = len(history.of_kind("variable"))
    charts = history_charts(history)
    split, panels = len(charts) - variables, lattice_charts(history)
    is_section = contents.subject is not None and contents.subject.is_section
    flows = [
        table for table in (flow_table(history, is_section), estimate_table(contents.estimates)) if table is not None
    ]
    return [
        Section("history", "Optimisation", lines, charts[:split], [history_table(history)]),
        *([Section("flow", "Flow", [], panels, flows)] if flows or panels else []),
        Section("variables", "Design variables", [], charts[split:], [variable_table(history)]),
    ]


def _time_text(seconds: float) -> str:
    """Format a duration."""
    minutes, rest = divmod(round(float(seconds)), 60)
    return (
        f"{seconds:.3g} s" if minutes == 0 else f"{minutes} min {rest} s" if minutes < 60 else f"{minutes / 60:.1f} h"
    )


def _subtitle(contents: Contents) -> str:
    """Line below the heading."""
    subject = contents.subject
    return "An optimisation, without its grid" if subject is None else f"{subject.source}: {subject.size}"


def _cards(contents: Contents, numbers: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Key figures: what, how much, and a remark."""
    cards: list[tuple[str, str, str]] = []
    history = contents.history
    if history is not None:
        best = history.best
        for q in history.of_kind("objective"):
            first, last = q.values[0, 0], q.values[best, 0]
            change = f", {100.0 * (last / first - 1.0):+.1f} %" if first else ""
            if history.infeasible(0):
                change = ", infeasible"
            word = "infeasible, " if history.infeasible(best) else ""
            cards.append((q.name, number(last), f"{word}from {number(first)}{change}"))
        if history.convergence is not None:
            found = history.convergence
            cards.append(
                ("largest violation", number(found.violations[best], 2), f"from {number(found.violations[0], 2)}")
            )
            if found.residuals.size:
                cards.append(("optimality", number(found.residuals[-1], 2), f"from {number(found.residuals[0], 2)}"))
        cards.append(("evaluations", f"{history.n_evaluations}", _time_text(history.seconds[-1])))
    if contents.subject is not None:
        cards += [numbers["card"]] if history is not None else [*contents.subject.cards, numbers["card"]]
    return cards


def _diagram(case_file: Path) -> tuple[str | None, tuple[str, ...]]:
    """N2 diagram of a case file, and what is missing."""
    with sound_cases(case_file) as sound:
        if not (om.CaseReader(str(sound.file)).problem_metadata or {}).get("tree"):
            text = "The N2 diagram is not in the case file: record with om.SqliteRecorder(file) and no other options."
            return None, (text,)
        try:
            return diagram_of(str(sound.file)), ()
        except Exception as error:  # if the tree is damaged
            return None, (f"The N2 diagram in the case file is damaged ({type(error).__name__}): record it again.",)


def diagram_of(source: om.Problem | str | os.PathLike) -> str:
    """N2 diagram of a problem or a case file, a whole HTML page."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "n2.html"
        om.n2(source, outfile=str(file), show_browser=False, display_in_notebook=False)
        return file.read_text(encoding="utf-8")


def _json(graph_objects: Any, data: list[dict], layout: dict) -> str:
    """Figure of plotly as JSON; arrays are packed, and the page sets its colours."""
    return graph_objects.Figure(data=data, layout={"template": "none", **layout}).to_json()


def _harmless(text: str) -> str:
    """JSON that does not end the script that contains it."""
    return text.replace("<", "\\u003c")
