"""One call shows a grid, a fitted grid or a problem; what it shows is what is there."""

import sys

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, GridMovement, InputError, fit_grid
from bspline_mdao.flow import Snapshot
from bspline_mdao.generators import brick_grid, onera_m6_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality
from bspline_mdao.grids.topology.grid import Grid
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import moving_mesh
from bspline_mdao.plotting import plot, sheets_of, wall_quads
from bspline_mdao.studio.plotting import plot as drawing
from bspline_mdao.studio.plotting.html import html_of
from bspline_mdao.studio.plotting.scenes import has_renderer
from bspline_mdao.studio.plotting.surfaces import flow_sheets, grid_sheets

image = pytest.importorskip("matplotlib.image", reason="matplotlib is not installed")
SIZE = (240, 160)


@pytest.fixture(scope="module")
def model():
    return fit_grid(onera_m6_grid((7, 6, 5)))


@pytest.fixture(scope="module")
def flown(model):
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("shape", GridMovement(model=model, quality=False), promotes=["*"])
    problem.model.add_subsystem("flow", EulerFlow(model=model, reference_area=1.16), promotes=["*"])
    problem.setup()
    problem.run_model()
    return problem


@pytest.fixture
def by_matplotlib(monkeypatch):
    monkeypatch.setattr(drawing, "has_renderer", lambda: False)


def colored(path) -> float:
    """Part of the pixels that is coloured."""
    return float((np.ptp(image.imread(path)[..., :3], axis=-1) > 0.1).mean())


@pytest.mark.parametrize("show", [None, "walls", "symmetry", "quality", "corner", "wall height", "patch", "wing_upper"])
def test_a_model_is_plotted_into_a_picture(model, show, by_matplotlib, tmp_path):
    assert model.plot(show, tmp_path / "model.png", size=SIZE) == tmp_path / "model.png"
    pixels = image.imread(tmp_path / "model.png")[..., :3]
    assert pixels.shape[:2] == (160, 240)
    assert (pixels.min(axis=-1) < 0.9).mean() > 0.01


def test_a_field_colours_the_picture_and_walls_alone_do_so_less(model, by_matplotlib, tmp_path):
    for show in ("quality", "walls"):
        model.plot(show, tmp_path / f"{show}.png", size=SIZE)
    assert colored(tmp_path / "quality.png") > 2.0 * colored(tmp_path / "walls.png") > 0.0


@pytest.mark.slow
def test_pyvista_renders_the_same_call(model, flown, tmp_path):
    if not has_renderer():
        pytest.skip("PyVista does not render here")
    model.plot(("walls", "control mesh", "quality"), tmp_path / "one.png", size=SIZE)
    plot(flown, file=tmp_path / "two.png", before=Snapshot.of(flown, "before"), size=SIZE)
    assert colored(tmp_path / "one.png") > 0.05
    both = image.imread(tmp_path / "two.png")
    assert both.shape[:2] == (160, 480)
    np.testing.assert_allclose(both[40:120, :240], both[40:120, 240:], atol=0.02)  # the same flow, twice


def test_pressures_on_sheets_are_those_of_the_wall_faces(model, flown):
    sheets = [s for s in sheets_of(flown, ("walls", "symmetry"), "Cp") if s.kind == "wall"]
    nodes, quads = flown.get_val("grid").reshape(-1, 3), wall_quads(model)
    middles = nodes[quads].mean(axis=1)
    found, values = [], []
    for sheet in sheets:
        x = sheet.points
        found.append((0.25 * (x[1:, 1:] + x[:-1, 1:] + x[1:, :-1] + x[:-1, :-1])).reshape(-1, 3))
        values.append(sheet.values["Cp"].ravel())
    np.testing.assert_allclose(np.concatenate(found), middles, atol=1e-12)
    np.testing.assert_array_equal(np.concatenate(values), flown.get_val("Cp"))


def test_the_flow_beside_the_plane_is_that_of_the_cells_there(model, flown):
    state = Snapshot.of(flown)
    plane = next(
        s for s in flow_sheets(model, state.grid, state.pressures, state.states, state.mach) if s.kind == "symmetry"
    )
    first = sum(int(np.prod(np.array(shape) - 1)) for shape in state.grid.shapes[: plane.window.block])
    shape = tuple(n - 1 for n in state.grid.shapes[plane.window.block])
    rows = state.states.reshape(-1, 5)[first : first + int(np.prod(shape))].reshape(*shape, 5)
    flat = next(d for d in range(3) if plane.window.lo[d] == plane.window.hi[d])
    behind = np.take(rows, 0 if plane.window.lo[flat] == 0 else -1, axis=flat)
    speed = np.linalg.norm(behind[..., 1:4], axis=-1) / np.sqrt(1.4 * behind[..., 4] / behind[..., 0])
    assert plane.values["Mach"].shape == speed.shape
    np.testing.assert_allclose(plane.values["Mach"] / speed, (plane.values["Mach"] / speed).flat[0], rtol=1e-12)


def test_a_snapshot_stays_as_it_was(flown):
    before = Snapshot.of(flown, "before")
    kept = before.states.copy()
    flown.set_val("alpha", 3.0)
    flown.run_model()
    np.testing.assert_array_equal(before.states, kept)
    assert not np.allclose(Snapshot.of(flown).states, kept)


def test_quality_of_a_face_is_that_of_the_cell_behind_it():
    grid = onera_m6_grid((7, 6, 5))
    quality = GridQuality.of_baseline(grid)
    cells = quality.cells(grid.to_vector().reshape(-1, 3))
    for sheet in grid_sheets(grid, fields=True):
        flat = next(d for d in range(3) if sheet.window.lo[d] == sheet.window.hi[d])
        layer = np.take(cells[sheet.window.block].q, 0 if sheet.window.lo[flat] == 0 else -1, axis=flat)
        lo, hi = (np.delete(np.array(ends), flat) for ends in (sheet.window.lo, sheet.window.hi))
        np.testing.assert_array_equal(sheet.values["Q"], layer[lo[0] : hi[0], lo[1] : hi[1]])


def test_a_grid_without_patches_shows_its_boundary(by_matplotlib, tmp_path):
    grid = Grid(brick_grid((3, 4, 5, 3)).blocks)
    assert {sheet.kind for sheet in grid_sheets(grid)} == {"other"}
    assert grid.plot(file=tmp_path / "brick.png", size=SIZE).is_file()


@pytest.mark.parametrize(
    ("call", "advice"),
    [
        (lambda grid, path: grid.plot(file=path / "wing.jpg"), "name it wing.png"),
        (lambda grid, path: grid.plot("pressure", path / "a.png"), "no 'pressure'; choose from walls"),
        (lambda grid, path: grid.plot(("quality", "corner"), path / "a.png"), "one field at a time"),
        (lambda grid, path: grid.plot("Cp", path / "a.png"), "there is no flow to show"),
        (lambda grid, path: grid.plot("control mesh", path / "a.png"), "fit_grid(grid).plot"),
        (lambda grid, path: grid.plot(file=path / "no" / "a.png"), "there is no folder"),
        (lambda grid, path: plot(3, file=path / "a.png"), "nothing to look at in a int"),
        (lambda grid, path: grid.plot(file=path / "a.png", before=True), "does not know what it was before"),
    ],
)
def test_what_cannot_be_shown_is_said_in_one_line(call, advice, tmp_path):
    with pytest.raises(InputError, match=advice.replace("(", r"\(").replace(")", r"\)")) as caught:
        call(onera_m6_grid((7, 6, 5)), tmp_path)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_without_a_screen_and_a_file_the_advice_is_to_name_a_file(monkeypatch):
    pytest.importorskip("pyvista", reason="PyVista is not installed")
    monkeypatch.setattr(drawing, "has_screen", lambda: False)
    with pytest.raises(InputError, match=r"file='picture\.png'"):
        onera_m6_grid((7, 6, 5)).plot()


def test_a_notebook_shows_a_table_and_a_picture(model):
    grid = model.regenerate()
    report = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3))
    for what, shown in ((model, "control points"), (grid, "wing_upper"), (report, "smallest corner")):
        html = what._repr_html_()
        assert shown in html
        assert "data:image/png;base64" in html
        assert len(html) < 100_000


def test_without_matplotlib_the_table_stays(model, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "base64" not in html_of(model)
    assert "control points" in html_of(model)


def test_what_users_print_is_one_short_line(model):
    mesh = moving_mesh(model)
    quality = GridQuality.of_baseline(model.regenerate())
    parts = model.topology, model.mesh, model.grid_map(), model.evaluator(), mesh, SurfaceGrid.of(model), quality
    for what in (model, model.regenerate(), model.regenerate().blocks[0], *parts):
        assert repr(what).startswith(type(what).__name__ + "(")
        assert len(repr(what)) <= 120
        assert "\n" not in repr(what)


@pytest.mark.parametrize("names", [("client", "trame"), ("client",), ()])
def test_a_notebook_asks_for_trame_where_pyvista_has_it(monkeypatch, names):
    from types import SimpleNamespace

    pyvista = pytest.importorskip("pyvista", reason="pyvista is not installed")
    backends = tuple(SimpleNamespace(name=name) for name in names)
    monkeypatch.setattr(pyvista, "registered_jupyter_backends", lambda: backends, raising=False)
    monkeypatch.setattr(drawing, "_in_notebook", lambda: True)
    asked = []
    drawing._show(SimpleNamespace(show=lambda **how: asked.append(how["jupyter_backend"])))
    assert asked == ["trame" if "trame" in names else "static"]
