"""A recorder writes the grids of an optimisation as a series that ParaView plays."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import openmdao.api as om
import pytest
from mesh_cases import mesh_around_a_body

from bspline_mdao import EulerFlow, GridMovement, InputError, NLoptDriver, fit_grid
from bspline_mdao.design import FreeForm, Lattice, Parametrization, ReferenceAxis, Twist
from bspline_mdao.flow import SeriesRecorder, Snapshot
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.meshes import LatticeSettings, MeshModel
from bspline_mdao.movers import moving_mesh


@pytest.fixture(scope="module")
def model():
    return fit_grid(onera_m6_grid((7, 6, 5)))


def twisted(model, driver, recorder):
    """A problem that twists the wing until a point of its surface is where it should be."""
    mesh = moving_mesh(model)
    variables = Parametrization(mesh, [Twist("twist", ReferenceAxis.of(mesh), stations=2)])
    problem = om.Problem(driver=driver, reports=None)
    problem.model.add_subsystem("shape", GridMovement(model=model, parametrization=variables), promotes=["*"])
    n = 3 * model.n_nodes
    sizes = {"twist": {"val": np.zeros(2), "units": "deg"}, "grid": {"val": np.zeros(n), "units": "m"}}
    goal = om.ExecComp("f = sum((twist - 2.0)**2) + 1e-6*sum(grid)", has_diag_partials=False, **sizes)
    problem.model.add_subsystem("goal", goal, promotes=["*"])
    problem.model.add_design_var("twist", lower=-5.0, upper=5.0)
    problem.model.add_objective("f")
    driver.add_recorder(recorder)
    problem.setup(mode="rev")
    return problem


DRIVERS = {
    "SciPy": lambda: om.ScipyOptimizeDriver(optimizer="SLSQP", disp=False),
    "NLopt": lambda: NLoptDriver(optimizer="LD_SLSQP", disp=False),
}


def series(path):
    """Numbers of the iterations, and their files by the names of the parts."""
    found = {}
    for item in ElementTree.parse(path).getroot().iter("DataSet"):
        found.setdefault(int(item.get("timestep")), {})[item.get("name")] = path.parent / item.get("file")
    return found


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_driver_leaves_a_series_that_ends_at_the_optimum(model, driver, tmp_path, pyvista):
    problem = twisted(model, DRIVERS[driver](), SeriesRecorder(tmp_path / "wing.pvd"))
    problem.run_driver()
    problem.cleanup()
    found = series(tmp_path / "wing.pvd")
    n_runs = problem.driver.iter_count
    assert 2 <= len(found) <= n_runs
    assert all(list(files) == ["grid", "control mesh"] for files in found.values())
    first, last = (pyvista.read(found[n]["grid"]) for n in (min(found), max(found)))
    baseline = model.regenerate()
    np.testing.assert_allclose(
        first[0].points, baseline.blocks[0].nodes.transpose(2, 1, 0, 3).reshape(-1, 3), atol=1e-12
    )
    end = Snapshot.of(problem)
    moved = np.concatenate([block.points for block in last])
    expected = np.concatenate([block.nodes.transpose(2, 1, 0, 3).reshape(-1, 3) for block in end.grid.blocks])
    np.testing.assert_allclose(moved, expected, atol=1e-12)
    assert np.abs(moved - np.concatenate([block.points for block in first])).max() > 0.01
    assert {"Q", "smallest_corner", "wall_height", "block", "patch"} <= set(last[0].cell_data)
    reader = pyvista.get_reader(str(tmp_path / "wing.pvd"))
    assert reader.number_time_points == len(found)
    control = pyvista.read(found[min(found)]["control mesh"])
    assert sum(block.n_points for block in control) == sum(ids.size for ids in model.mesh.control_ids)


def test_every_run_of_the_model_is_there_where_all_are_wanted(model, tmp_path):
    problem = twisted(model, DRIVERS["NLopt"](), SeriesRecorder(tmp_path / "wing.pvd", which="all"))
    problem.run_driver()
    assert len(series(tmp_path / "wing.pvd")) == problem.driver.iter_count


def test_a_driver_without_derivatives_leaves_all_its_runs(model, tmp_path):
    driver = NLoptDriver(optimizer="LN_COBYLA", maxeval=4, disp=False)
    problem = twisted(model, driver, SeriesRecorder(tmp_path / "wing.pvd"))
    problem.run_driver()
    assert len(series(tmp_path / "wing.pvd")) >= 4


@pytest.mark.slow
def test_a_flow_is_in_the_series_with_its_walls(model, tmp_path, pyvista):
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("shape", GridMovement(model=model, quality=False), promotes=["*"])
    problem.model.add_subsystem("flow", EulerFlow(model=model, reference_area=1.16), promotes=["*"])
    problem.driver.add_recorder(SeriesRecorder(tmp_path / "wing.pvd", which="all"))
    problem.setup()
    problem.run_driver()
    (files,) = series(tmp_path / "wing.pvd").values()
    assert list(files) == ["grid", "walls", "control mesh"]
    walls = pyvista.read(files["walls"])
    pressures = np.concatenate([wall.cell_data["Cp"] for wall in walls])
    assert np.sort(pressures) == pytest.approx(np.sort(problem.get_val("Cp")), abs=1e-14)
    for name in ("Mach", "entropy", "Q", "wall_height", "patch"):
        assert all(np.isfinite(wall.cell_data[name]).all() for wall in walls), name


@pytest.mark.parametrize(
    ("arguments", "advice"),
    [
        (("wing.vtm",), "name it wing.pvd"),
        (("no/wing.pvd",), "no folder 'no'"),
        (("wing.pvd", "some"), "give one of major, all"),
    ],
)
def test_a_series_that_cannot_be_is_refused_at_once(arguments, advice):
    with pytest.raises(InputError, match=re.escape(advice)):
        SeriesRecorder(*arguments)


def test_a_full_disk_leaves_iterations_out_and_does_not_end_the_run(model, tmp_path, monkeypatch):
    problem = twisted(model, DRIVERS["NLopt"](), SeriesRecorder(tmp_path / "wing.pvd", which="all"))
    write, numbers = Snapshot.write, []

    def full(snapshot, path):
        numbers.append(int(path.stem))
        if len(numbers) in (2, 3):
            raise InputError(f"{path}: cannot be written (No space left on device); choose another place")
        return write(snapshot, path)

    monkeypatch.setattr(Snapshot, "write", full)
    with pytest.warns(om.CaseRecorderWarning, match="an iteration is missing .*No space left") as caught:
        assert problem.run_driver().success
    problem.cleanup()
    assert len([each for each in caught if each.category is om.CaseRecorderWarning]) == 1
    assert list(series(tmp_path / "wing.pvd")) == [n for n in numbers if n not in numbers[1:3]]


@pytest.mark.slow
def test_a_mesh_leaves_cells_walls_and_lattice(tmp_path, pyvista):
    model = MeshModel.of(*mesh_around_a_body(), LatticeSettings(spacing=0.4))
    mesh = moving_mesh(model)
    lift = FreeForm("lift", Lattice.box(mesh, (2, 2, 2)), direction="z")
    shape = Parametrization(mesh, [lift])
    problem = om.Problem(reports=None)
    problem.model.add_subsystem(
        "shape", GridMovement(model=model, parametrization=shape, quality=False), promotes=["*"]
    )
    problem.driver.add_recorder(SeriesRecorder(tmp_path / "body.pvd", which="all"))
    problem.setup()
    problem.set_val("lift", 0.1 * np.arange(lift.point_ids(shape.layout).size))
    problem.run_driver()
    (files,) = series(tmp_path / "body.pvd").values()
    assert list(files) == ["grid", "walls", "control mesh"]
    cells, walls, lattice = (pyvista.read(file) for file in files.values())
    nodes = problem.get_val("grid").reshape(-1, 3)
    np.testing.assert_array_equal(cells.points, nodes)
    np.testing.assert_allclose(cells.point_data["displacement"], nodes - model.mesh.points, atol=1e-15)
    assert {"non_orthogonality", "pyramid"} <= set(cells.cell_data)
    assert np.nanmin(cells.cell_data["pyramid"]) < 0.99
    assert (walls.n_points, walls.n_cells) == (len(model.wall_rows), len(model.walls.faces))
    assert np.isfinite(walls.point_data["wall_height"]).all()
    np.testing.assert_array_equal(walls.cell_data["marker"], 1)
    assert lattice[0].n_points == model.lattice.n_control
    with pytest.raises(InputError, match=r"goes to a .vtu file; name it body.vtu"):
        Snapshot.of(model).write(tmp_path / "body.vtm")
    assert Snapshot.of(model.mesh).write(tmp_path / "alone.vtu") == {"grid": tmp_path / "alone.vtu"}
