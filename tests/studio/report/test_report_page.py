"""The page says what the model and the case file hold, and what they do not."""

import json
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import openmdao.api as om
import pytest
from report_cases import recorded_wing, small_model, twisted_wing

from bspline_mdao import FittedModel, GridMovement, design_summary, fit_grid, optimality_of, write_report
from bspline_mdao.core.om.drivers.case_history import read_history
from bspline_mdao.design import Parametrization, Translation
from bspline_mdao.errors import InputError
from bspline_mdao.flow.euler.error_estimate import ErrorEstimate
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.length_unit import in_unit
from bspline_mdao.movers import moving_mesh
from bspline_mdao.plotting import faces_around, wall_quads
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.plotting.cuts import cut
from bspline_mdao.studio.report import openmdao_report
from bspline_mdao.studio.report.charts import history_charts, section_chart
from bspline_mdao.studio.report.shape import Axes, Shape
from bspline_mdao.studio.report.walls import DrawnWalls

pytest.importorskip("plotly", reason="plotly is not installed")
pytest.importorskip("jinja2", reason="jinja2 is not installed")


class Page(HTMLParser):
    """Text, tables, drawings and figures of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.words, self.charts, self.inside = [], [], {}, ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.inside = dict(attributes).get("id") if tag == "script" else None if tag == "style" else ""

    def handle_endtag(self, tag):
        self.inside = ""

    def handle_data(self, data):
        if self.inside == "":
            self.words.append(data)
        elif self.inside:
            self.charts[self.inside.removeprefix("chart-")] = json.loads(data)

    @property
    def text(self):
        return re.sub(r"\s+", " ", " ".join(self.words))

    def all(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture(scope="module")
def case_file(model, tmp_path_factory):
    return recorded_wing(tmp_path_factory.mktemp("case"), model)


@pytest.fixture(scope="module")
def page(model, case_file, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "wing.html"
    numbers = write_report(path, case_file, model, title="A <wing> & more")
    assert numbers["missing"] == []
    assert numbers["bytes"] == path.stat().st_size
    return Page(path.read_text(encoding="utf-8"))


def test_the_page_has_all_sections_of_an_optimisation(page):
    sections = [attributes["id"] for attributes in page.all("section")]
    assert sections == ["space", "history", "flow", "variables", "sections", "quality", "heights", "fit", "diagram"]
    assert {f"#{name}" for name in sections} <= {link.get("href") for link in page.all("a")}
    assert "A <wing> & more" in page.text


def test_what_is_drawn_is_told_in_words_and_every_table_has_headings(page):
    drawings = [a for a in page.all("div") if "data-chart" in a]
    assert len(drawings) == len(page.charts) - 1  # the N2 diagram is no drawing
    assert all(a["role"] == "img" and len(a["aria-label"]) > 20 for a in drawings)
    assert len(page.all("caption")) == len(page.all("table")) == 7
    assert {a.get("scope") for a in page.all("th")} == {"col", "row"}


def test_the_page_asks_nothing_of_a_network(page):
    asked = [a.get("src") or a.get("href") for tag, a in page.tags if tag in ("script", "link", "img", "a", "iframe")]
    assert [name for name in asked if name and not name.startswith(("#", "data:"))] == []


def test_the_tables_hold_the_numbers_of_the_case_file(page, case_file):
    history = read_history(case_file)
    for quantity in history.quantities:
        for value in quantity.values[history.best]:
            assert f"{value:.4g}" in page.text or f"{value:.6g}" in page.text, quantity.name
    assert {"twist[0]", "twist[1]"} <= set(page.text.split())
    assert f"{history.n_evaluations} evaluations by ScipyOptimize_SLSQP" in page.text


def test_the_page_says_which_design_is_infeasible_and_by_how_much(page, case_file):
    history = read_history(case_file)
    words = history.infeasible(0)
    assert words.startswith("infeasible: CL is ")
    assert words.endswith(" 0.25")
    assert f"The first design is {words}." in page.text
    is_said = "infeasible, from" in page.text and f"The best design is {history.infeasible(history.best)}." in page.text
    assert is_said == bool(history.infeasible(history.best))


def test_both_shapes_and_their_pressures_are_drawn(page, model):
    traces = page.charts["space"]["data"]
    meshes = [t for t in traces if t["type"] == "mesh3d"]
    assert {(t["meta"]["shape"], t["meta"]["color"]) for t in meshes} == {
        (shape, color) for shape in (0, 1) for color in ("plain", "Cp", "quality", "height", "displacement")
    }
    assert sum(t["visible"] for t in meshes) == 1
    assert {t["name"] for t in page.charts["pressure-Cp"]["data"]} == {"Before", "After"}


def test_pressures_are_named_by_the_place_of_their_strip_and_each_strip_is_drawn_once(page, model):
    quads = model.regenerate().to_vector().reshape(-1, 3)[wall_quads(model)]
    notes = " ".join(note["text"] for note in page.charts["pressure-Cp"]["layout"]["annotations"])
    places = re.findall(r"z = ([-+.e\d]+) m", notes)
    strips = [faces_around(quads, float(place)) for place in places]
    assert len(places) == len({tuple(strip) for strip in strips}) > 1
    for place, strip in zip(places, strips):
        assert float(place) == pytest.approx(quads[strip, :, 2].mean(), rel=6e-3)


def test_convergence_has_no_chart_without_derivatives_where_nothing_is_violated(case_file):
    history = read_history(case_file)
    recorded = history.convergence
    nothing = recorded._replace(residuals=np.array([]), violations=0.0 * recorded.violations)
    keys = [chart.key for chart in history_charts(replace(history, convergence=nothing))]
    assert "convergence" in [chart.key for chart in history_charts(history)]
    assert "convergence" not in keys


def test_a_model_alone_has_a_page_of_its_own(model, tmp_path):
    numbers = write_report(tmp_path / "model.html", model)
    page = Page((tmp_path / "model.html").read_text(encoding="utf-8"))
    assert [a["id"] for a in page.all("section")] == ["space", "sections", "quality", "heights", "fit"]
    assert numbers["missing"] == []
    assert f"{model.n_nodes:,} nodes" in page.text
    assert numbers["bytes"] < 6_000_000


def test_a_grid_without_patches_is_drawn_as_its_boundary(tmp_path):
    from dataclasses import replace

    grid = replace(onera_m6_grid((5, 5, 5)), patches=())
    write_report(tmp_path / "bare.html", fit_grid(grid))
    page = Page((tmp_path / "bare.html").read_text(encoding="utf-8"))
    assert "the boundary, since no patch is a wall" in page.text
    assert [a["id"] for a in page.all("section")] == ["space", "quality", "fit"]


@pytest.mark.slow
def test_lengths_of_the_grid_are_in_its_unit_everywhere_on_the_page_and_other_lengths_in_their_own(tmp_path):
    model = fit_grid(in_unit(onera_m6_grid((5, 5, 5)), "mm"))
    problem = om.Problem(driver=om.ScipyOptimizeDriver(optimizer="SLSQP", maxiter=2, disp=False), reports=None)
    variables = Parametrization(moving_mesh(model), [Translation("place", "y")])
    shape = GridMovement(model=model, parametrization=variables, quality=["corner_ks"])
    problem.model.add_subsystem("shape", shape, promotes=["*"])
    spar = om.ExecComp("f = (t - 1)**2 + (place - 0.1)**2", t={"units": "m"}, place={"units": "m"})
    problem.model.add_subsystem("spar", spar, promotes=["*"])
    problem.model.set_input_defaults("place", 0.0, units="m")
    problem.model.set_input_defaults("t", 2.0, units="m")
    problem.model.add_design_var("place", lower=-1.0, upper=1.0, units="m")
    problem.model.add_design_var("t", lower=0.0, upper=3.0, units="m")
    problem.model.add_objective("f")
    problem.setup()
    problem.driver.add_recorder(om.SqliteRecorder(tmp_path / "a.sql"))
    problem.driver.recording_options["includes"] = ["control_points"]
    problem.run_driver()
    problem.cleanup()
    write_report(tmp_path / "a.html", tmp_path / "a.sql", model)
    page = Page((tmp_path / "a.html").read_text())
    rows = dict(re.findall(r" (place|t) [-\d. e]+ (?:no|upper|lower) (\S+)", page.text))
    assert rows == {"place": "mm", "t": "m"} == {e.name: e.units for e in design_summary(problem).entries[1:]}
    for words in ("smallest volume (mm³)", "Displacement (mm)"):
        assert words in page.text
    for number, title in ((100, "place (mm)"), (101, "t (m)")):
        assert page.charts[f"history{number}"]["layout"]["yaxis"]["title"]["text"] == title
    assert page.charts["space"]["layout"]["scene"]["xaxis"]["title"]["text"] == "x (mm)"


def test_what_is_missing_is_said_and_the_advice_is_right(tmp_path):
    model = small_model()  # other tests save theirs, and its file is found
    file = recorded_wing(tmp_path, model, includes=(), record_derivatives=False)
    alone = write_report(tmp_path / "alone.html", file)
    with_model = write_report(tmp_path / "with.html", file, model)
    assert "--model MODEL.h5" in alone["missing"][0]
    assert 'recording_options["includes"] = ["*control_points", "*Cp"]' in with_model["missing"][0]
    pages = [Page((tmp_path / f"{name}.html").read_text(encoding="utf-8")) for name in ("alone", "with")]
    assert all('recording_options["record_derivatives"] = True' in page.text for page in pages)
    assert [a["id"] for a in pages[0].all("section")] == ["history", "flow", "variables", "diagram", "missing"]


def test_the_model_of_another_optimisation_is_refused(case_file, tmp_path):
    other = fit_grid(onera_m6_grid((7, 5, 5)))
    with pytest.raises(InputError, match="give the model that was optimised"):
        write_report(tmp_path / "wing.html", case_file, other)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.sql", "-o", "page.html"], "none.sql: there is no such case file"),
        (["none.h5", "-o", "page.html"], "none.h5"),
        (["wing.h5", "-o", "page.pdf"], "page.pdf: a report is an HTML file"),
        (["wing.h5", "-o", "page.html", "--model", "wing.h5"], "is a model already"),
        (["text.sql", "-o", "page.html"], "text.sql: is no case file"),
    ],
)
def test_wrong_input_ends_in_one_line(model, tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    model.save("wing.h5")
    (tmp_path / "text.sql").write_text("no database")
    before = sorted(tmp_path.iterdir())
    assert run(["report", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


def test_a_missing_library_is_named(model, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    with pytest.raises(InputError, match=r'a report needs plotly: pip install "bspline_mdao\[report\]"'):
        write_report(tmp_path / "page.html", model)


def test_the_command_writes_page_and_numbers(model, case_file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    model.save("wing.h5")
    assert run(["report", str(case_file), "--model", "wing.h5", "-o", "page.html", "--json", "page.json"]) == 0
    numbers = json.loads((tmp_path / "page.json").read_text())
    assert numbers["bytes"] == (tmp_path / "page.html").stat().st_size
    assert numbers["missing"] == []
    assert "needs no network" in capsys.readouterr().out


def test_openmdao_makes_the_page_and_records_what_it_needs(model, tmp_path, monkeypatch):
    monkeypatch.setenv("OPENMDAO_WORKDIR", str(tmp_path))
    monkeypatch.setenv("OPENMDAO_REPORTS", "1")
    monkeypatch.delenv("TESTFLO_RUNNING", raising=False)
    problem = twisted_wing(model, reports=[openmdao_report.NAME], name="reported")
    problem.run_driver()
    problem.cleanup()
    folder = problem.get_reports_dir()
    page = Page((folder / openmdao_report.PAGE).read_text(encoding="utf-8"))
    assert "missing" not in [a["id"] for a in page.all("section")]
    assert "diagram" in [a["id"] for a in page.all("section")]
    history = read_history(folder / openmdao_report.CASES)
    assert history.convergence.residuals.size > 0


def test_a_problem_without_a_grid_has_no_such_report(tmp_path, monkeypatch):
    monkeypatch.setenv("OPENMDAO_WORKDIR", str(tmp_path))
    monkeypatch.setenv("OPENMDAO_REPORTS", "1")
    problem = om.Problem(reports=[openmdao_report.NAME], name="plain")
    problem.model.add_subsystem("f", om.ExecComp("y = x**2"), promotes=["*"])
    problem.setup()
    problem.run_driver()
    assert not (problem.get_reports_dir() / openmdao_report.PAGE).exists()


def test_the_last_optimality_is_that_of_the_problem(case_file, model):
    """The file alone, with units, scaling and bounds, gives the numbers that the problem gives."""
    history = read_history(case_file)
    n = int(history.convergence.differentiated[-1])
    problem = twisted_wing(model)
    problem.set_val("twist", history.quantities[0].values[n], units="deg")
    problem.run_model()
    residual, violation = optimality_of(problem)
    assert history.convergence.residuals[-1] == pytest.approx(residual, rel=1e-4)
    assert history.convergence.violations[n] == pytest.approx(violation, rel=1e-5)


def test_few_triangles_are_drawn_of_many_and_edges_stay():
    model = fit_grid(onera_m6_grid((17, 13, 5)))
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    walls = DrawnWalls.of(model.topology, nodes, 150)
    assert walls.n_triangles <= 150 < walls.n_of_all
    for face, drawn in zip(walls.faces, walls.drawn):
        for corner in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
            assert face[corner] == drawn[corner]
    sampled = [{*drawn[0], *drawn[-1], *drawn[:, 0], *drawn[:, -1]} for drawn in walls.drawn]
    assert len({walls.sources[n] for rows in sampled for n in rows}) < sum(
        map(len, sampled)
    )  # faces meet on their edges


def test_values_at_nodes_are_means_of_the_faces_around_across_blocks():
    rng = np.random.default_rng(3)
    model = small_model()
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    walls = DrawnWalls.of(model.topology, nodes, 1000)
    corners, values = walls.quads(), rng.random(len(walls.quads()))
    found = walls.of_faces(corners, values)
    for row, value in zip(walls.rows, found):
        around = (walls.sources[corners] == walls.sources[row]).any(axis=1)
        assert value == pytest.approx(values[around].mean())


def test_a_cut_of_a_ball_is_a_circle():
    theta, phi = np.meshgrid(np.linspace(0.01, 3.13, 40), np.linspace(0.0, 2 * np.pi, 60), indexing="ij")
    ball = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    rows = np.arange(theta.size).reshape(theta.shape)
    quads = np.stack([rows[:-1, :-1], rows[1:, :-1], rows[1:, 1:], rows[:-1, 1:]], axis=-1).reshape(-1, 4)
    ends = cut(ball.reshape(-1, 3), quads, 1, 0.6)
    np.testing.assert_allclose(ends[..., 1], 0.6)
    np.testing.assert_allclose(np.hypot(ends[..., 0], ends[..., 2]), 0.8, atol=5e-3)
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(1.6 * np.pi, rel=5e-3)


def test_a_section_of_the_page_is_one_curve_around_the_wing_across_its_blocks():
    model = fit_grid(onera_m6_grid((13, 5, 5)))
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    walls, axes = DrawnWalls.of(model.topology, nodes, 100), Axes(0, 2, 1)
    for trace in section_chart([Shape("wing", nodes, None)], walls.quads(), axes).data:
        line = np.stack([trace["x"], trace["y"]], axis=1)
        assert np.isnan(line[[0, -1]]).all()
        assert not np.isnan(line[1:-1]).any()  # one line
        np.testing.assert_allclose(line[1], line[-2], atol=1e-12)  # from the trailing edge back to it
        steps = np.diff(line[1:-1], axis=0)
        directions = steps / np.linalg.norm(steps, axis=1, keepdims=True)
        assert np.sum(directions[1:] * directions[:-1], axis=1).min() > 0.9  # no corners at lines of a coarse grid


def test_a_loaded_model_is_reported_as_the_one_in_memory(model, tmp_path):
    model.save(tmp_path / "wing.h5")
    pages = []
    for name, source in (("a", model), ("b", FittedModel.load(tmp_path / "wing.h5"))):
        write_report(tmp_path / f"{name}.html", source, title="wing")
        pages.append(Page((tmp_path / f"{name}.html").read_text(encoding="utf-8")))
    assert pages[0].charts == pages[1].charts


def test_a_page_tells_what_lift_and_drag_would_be_on_a_finer_grid(model, case_file, tmp_path):
    estimates = {"CD": ErrorEstimate(0.02, 0.0125, 1.5, np.zeros(3), 0.00075)}
    write_report(tmp_path / "with.html", case_file, model, estimates=estimates)
    write_report(tmp_path / "without.html", case_file, model)
    with_them, without = (Page((tmp_path / f"{name}.html").read_text()).text for name in ("with", "without"))
    assert "Errors of the grid" not in without
    assert "which may be wrong by CD 0.02 0.0125 0.00075" in with_them
    assert "a grid of 1.5 times the cells per direction" in with_them


def test_a_page_tells_what_was_gained_on_a_finer_grid_and_where_it_is_in_doubt(model, case_file, tmp_path):
    before, sure, unsure = (
        {"CL": ErrorEstimate(0.2, 0.2, 1.5, np.zeros(3), 0.0)}
        | {"CD_induced": ErrorEstimate(drag, drag, 1.5, np.zeros(3), 0.0001)}
        for drag in (0.005, 0.004, 0.00495)
    )
    words = "CD_induced by the square of the lift: {} % less on this grid, {} % less on the finer one"
    for estimates, gain, is_doubted in ((sure, "20.0", False), (unsure, "1.0", True)):
        write_report(tmp_path / "gain.html", case_file, model, estimates=estimates, baseline=before)
        text = Page((tmp_path / "gain.html").read_text()).text
        assert words.format(gain, gain) in text
        assert ("may be all that was gained" in text) is is_doubted
