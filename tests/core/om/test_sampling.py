"""Many designs of one problem: plans, the file of designs, what is refused, runs that go on, several processes."""

import pickle
import shutil

import h5py
import numpy as np
import openmdao.api as om
import pytest
from mesh_cases import body_model

from bspline_mdao import DesignSurface, fit_grid
from bspline_mdao.base.sparse.cholesky import CholeskyFactor
from bspline_mdao.core.om.sampling.designs import PENDING
from bspline_mdao.design import Translation, Twist
from bspline_mdao.errors import InputError
from bspline_mdao.generators import flat_plate_grid
from bspline_mdao.measures import SurfaceArea
from bspline_mdao.sampling import Designs, LatinHypercube, Sobol, Table, sample


@pytest.fixture(scope="module")
def wing():
    return DesignSurface.of(fit_grid(flat_plate_grid((7, 6, 5))))


def problem_of(wing, bound=4.0, watch=None, **options) -> om.Problem:
    """A plate by its twist, its baseline in the middle of no range."""
    variables = [Twist("twist", wing.axis, stations=3)]
    settings = {
        "quality": False,
        "require_valid": False,
        "measures": [SurfaceArea.of(wing.surface, relative=False)],
    } | options
    problem = om.Problem(wing.grid_movement(variables, **settings), reports=None)
    if watch is not None:
        problem.model.add_subsystem("watch", watch, promotes=["*"])
    problem.model.add_design_var("twist", indices=[0, 2], lower=-bound, upper=0.7 * bound, ref=-3.0, units="deg")
    problem.setup()
    return problem


class Watch(om.ExplicitComponent):
    """Counts its runs, and fails at one."""

    def __init__(self, failure=None, at=-1):
        super().__init__()
        self.failure, self.at, self.n = failure, at, 0

    def setup(self):
        self.add_input("twist", np.zeros(3), units="deg")
        self.add_output("seen")

    def compute(self, inputs, outputs):
        self.n += 1
        if self.n == self.at:
            raise self.failure
        outputs["seen"] = inputs["twist"].sum()


def arrays(file) -> dict[str, np.ndarray]:
    found = {}
    with h5py.File(file) as opened:
        opened.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
    return found


def assert_close(found, expected):
    """Alike but for rounding."""
    if found.dtype.kind != "f":
        np.testing.assert_array_equal(found, expected)
    else:
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-13)


def test_designs_are_what_the_problem_gives_at_their_values(wing, tmp_path):
    designs = sample(problem_of(wing), wing.model, Sobol(5, seed=3), tmp_path / "a.h5", outputs=["surface_area"])
    assert len(designs) == 5
    again = problem_of(wing)
    for number, volume in enumerate(designs.outputs["surface_area"]):
        values, nodes = designs[number]
        again.set_val("twist", [values[0], 0.0, values[1]], units="deg")
        again.run_model()
        # values go through the scaling of the driver: one digit
        np.testing.assert_allclose(nodes.ravel(), again.get_val("grid"), rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(volume, again.get_val("surface_area"), rtol=1e-13)
    assert np.ptp(designs.values, axis=0).min() > 3.0
    assert designs.ranges == {"twist[0]": (-4.0, 2.8, "deg"), "twist[2]": (-4.0, 2.8, "deg")}
    with h5py.File(tmp_path / "a.h5") as found:
        assert found["outputs/surface_area"].attrs["units"] == "m**2"


def test_control_points_and_single_precision_give_the_same_grids(wing, tmp_path):
    nodes = sample(problem_of(wing), wing.model, Sobol(3), tmp_path / "nodes.h5")
    points = sample(problem_of(wing), wing.model, Sobol(3), tmp_path / "points.h5", store="control_points")
    single = sample(problem_of(wing), wing.model, Sobol(3), tmp_path / "single.h5", single=True)
    exact = nodes.grid(2, wing.model).to_vector()
    np.testing.assert_allclose(points.grid(2, wing.model).to_vector(), exact, rtol=0.0, atol=1e-13)
    assert single[2][1].dtype == np.float32
    np.testing.assert_allclose(single[2][1].ravel(), exact, rtol=1e-6, atol=1e-6)
    other = fit_grid(flat_plate_grid((6, 5, 5)))
    with pytest.raises(InputError, match="of another model"):
        nodes.grid(0, other)


def test_numbers_alone_are_kept_where_nothing_is_stored(wing, tmp_path):
    designs = sample(problem_of(wing), wing.model, Sobol(2), tmp_path / "a.h5", store="")
    assert designs[0][1].size == 0
    assert set(designs.quality) >= {"q_min", "min_corner", "height_min", "height_max"}
    with pytest.raises(InputError, match="store='nodes'"):
        designs.grid(0, wing.model)


def test_a_design_with_inverted_cells_is_refused_with_its_reason_and_has_no_numbers(wing, tmp_path):
    file = tmp_path / "table.csv"
    file.write_text("twist[0],twist[2]\n1.5,-2\n90,-170\n0.5,1\n")
    designs = sample(problem_of(wing), wing.model, Table(file), tmp_path / "a.h5")
    assert designs.rows.tolist() == [0, 2]
    assert list(designs.refused) == [1]
    assert "is inverted" in designs.refused[1]
    found = arrays(tmp_path / "a.h5")
    assert np.isnan(found["nodes"][1]).all()
    assert np.isnan(found["quality/q_min"][1])
    assert np.isfinite(found["nodes"][[0, 2]]).all()
    np.testing.assert_array_equal(designs.values, [[1.5, -2.0], [0.5, 1.0]])


def test_a_failed_analysis_is_a_refusal(wing, tmp_path):
    watch = Watch(om.AnalysisError("the flow stalls"), at=3)
    designs = sample(problem_of(wing, watch=watch), wing.model, Sobol(4), tmp_path / "a.h5", outputs=["seen"])
    assert [reason[-15:] for reason in designs.refused.values()] == ["the flow stalls"]
    assert list(designs.refused) == [1]
    assert len(designs) == 3


def test_a_run_that_was_stopped_goes_on_with_what_is_missing(wing, tmp_path):
    plan, file = LatinHypercube(6, seed=1), tmp_path / "a.h5"
    with pytest.raises(KeyboardInterrupt):
        sample(problem_of(wing, watch=Watch(KeyboardInterrupt(), at=5)), wing.model, plan, file)
    assert len(Designs(file)) == 3
    with pytest.raises(InputError, match="restart=True"):
        sample(problem_of(wing), wing.model, plan, file)
    watch = Watch()
    designs = sample(problem_of(wing, watch=watch), wing.model, plan, file, restart=True)
    assert len(designs) == 6
    assert watch.n == 1 + 3
    whole = sample(problem_of(wing), wing.model, plan, tmp_path / "b.h5")
    for number in range(6):
        assert_close(designs[number][1], whole[number][1])
    with pytest.raises(InputError, match="another plan"):
        sample(problem_of(wing), wing.model, LatinHypercube(6, seed=2), file, restart=True)
    with pytest.raises(InputError, match="another stored"):
        sample(problem_of(wing), wing.model, plan, file, restart=True, store="")


def test_several_processes_write_what_one_writes(wing, tmp_path):
    for processes in (1, 3):
        sample(problem_of(wing), wing.model, Sobol(5), tmp_path / f"{processes}.h5", processes=processes)
    one, three = (arrays(tmp_path / f"{n}.h5") for n in (1, 3))
    assert one.keys() == three.keys()
    for name, of_one in one.items():
        assert_close(of_one, three[name])


def test_control_meshes_move_together_where_nothing_but_the_geometry_comes_before(wing, tmp_path, monkeypatch):
    passes, solve = [], CholeskyFactor.solve
    monkeypatch.setattr(CholeskyFactor, "solve", lambda self, right: passes.append(right.shape) or solve(self, right))
    together = sample(problem_of(wing), wing.model, Sobol(5), tmp_path / "a.h5")
    assert [shape[2:] for shape in passes] == 2 * [()] + 2 * [(5,)]
    passes.clear()
    watch = Watch()
    alone = sample(problem_of(wing, watch=watch), wing.model, Sobol(5), tmp_path / "b.h5")
    assert [shape[2:] for shape in passes] == 12 * [()]
    assert watch.n == 6
    for number in range(5):
        assert_close(together[number][1], alone[number][1])


def test_a_process_that_dies_is_told_and_loses_its_designs_alone(wing, tmp_path):
    with pytest.raises(InputError, match="a process ended"):
        sample(
            problem_of(wing, watch=Watch(RuntimeError("broken"), at=3)),
            wing.model,
            Sobol(4),
            tmp_path / "a.h5",
            processes=2,
        )
    assert len(Designs(tmp_path / "a.h5")) == 2
    assert (arrays(tmp_path / "a.h5")["state"] == PENDING).sum() == 2


def test_generators_of_openmdao_are_plans_and_plans_are_generators(wing, tmp_path):
    cases = om.ListGenerator([[("twist", [1.0, -2.0])], [("twist", [0.5, 0.25])]])
    designs = sample(problem_of(wing), wing.model, cases, tmp_path / "a.h5")
    np.testing.assert_array_equal(designs.values, [[1.0, -2.0], [0.5, 0.25]])
    seen = []

    class Line(om.ExplicitComponent):
        def setup(self):
            self.add_input("a", 0.0)

        def compute(self, inputs, outputs):
            seen.append(inputs["a"].item())

    problem = om.Problem(om.Group(), reports=None, driver=om.DOEDriver(LatinHypercube(5)))
    problem.model.add_subsystem("line", Line(), promotes=["*"])
    problem.model.add_design_var("a", lower=2.0, upper=7.0)
    problem.setup()
    problem.run_driver()
    assert sorted(int(a) for a in seen) == [2, 3, 4, 5, 6]


def test_plans_fill_their_ranges_and_are_the_same_for_the_same_seed():
    ranges = {"a": {"size": 2, "lower": [0.0, 5.0], "upper": [1.0, 7.0]}, "b": {"size": 1, "lower": -1.0, "upper": 0.0}}
    for kind in (LatinHypercube, Sobol):
        plans = (kind(8, seed=seed)(ranges) for seed in (0, 0, 1))
        first, same, other = ([np.concatenate([values for _, values in case]) for case in plan] for plan in plans)
        np.testing.assert_array_equal(first, same)
        assert not np.array_equal(first, other)
        in_cube = (np.array(first) - [0.0, 5.0, -1.0]) / [1.0, 2.0, 1.0]
        for column in in_cube.T:  # both have one design in every eighth
            np.testing.assert_array_equal(np.sort(np.floor(8 * column)), np.arange(8))
    assert len(list(Sobol(5)(ranges))) == 5


def test_a_file_of_designs_is_a_dataset_for_workers(wing, tmp_path):
    designs = sample(problem_of(wing), wing.model, Sobol(3), tmp_path / "a.h5")
    copied = pickle.loads(pickle.dumps(designs))
    assert len(copied) == 3
    np.testing.assert_array_equal(copied[1][1], designs[1][1])
    with pytest.raises(IndexError):
        copied[3]


def test_meshes_without_structure_are_sampled(tmp_path):
    body = DesignSurface.of(body_model())
    shift = Translation("shift", direction="z")
    problem = om.Problem(body.grid_movement([shift], quality=False, require_valid=False), reports=None)
    problem.model.add_design_var("shift", lower=-0.05, upper=0.1)
    problem.setup()
    designs = sample(problem, body.model, Sobol(3), tmp_path / "a.h5", store="control_points")
    assert set(designs.quality) >= {"min_volume", "min_ratio", "height_min"}
    problem.set_val("shift", designs.values[2])
    problem.run_model()
    moved = designs.grid(2, body.model).points
    np.testing.assert_allclose(moved.ravel(), problem.get_val("grid"), rtol=0.0, atol=1e-13)
    assert np.abs(moved - body.model.mesh.points).max() > 0.01


def test_control_points_that_do_not_give_the_grid_are_not_stored_alone(wing, tmp_path):
    shape = wing.grid_movement([Twist("twist", wing.axis, stations=3)], quality=False, require_valid=False, fit=False)

    class Raised(om.Group):
        def setup(self):
            outputs = ["control_points", ("grid", "low")]
            self.add_subsystem("shape", shape, promotes_inputs=["*"], promotes_outputs=outputs)
            all_nodes = {"shape": 3 * wing.model.n_nodes, "units": "m"}
            raised = om.ExecComp("grid = low + 0.01 * twist[0]", low=all_nodes, grid=all_nodes, twist={"shape": 3})
            self.add_subsystem("raised", raised, promotes=["*"])

    problem = om.Problem(Raised(), reports=None)
    problem.model.add_design_var("twist", lower=1.0, upper=2.0)
    problem.model.set_input_defaults("twist", np.zeros(3), units="deg")
    problem.setup()
    with pytest.raises(InputError, match="control points alone"):
        sample(problem, wing.model, Sobol(2), tmp_path / "a.h5", store="control_points")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("twist[1]\n1\n", "no value of a variable; the values are twist\\[0\\], twist\\[2\\]"),
        ("twist[0]\nx\n", "line 2, twist\\[0\\]: 'x' is no number"),
        ("twist[0],twist[2]\n1\n", "line 2 has 1 values, and 2 have names"),
        ("twist[0],twist[0]\n1,2\n", "has two columns"),
        ("twist[0]\n", "a line of names, and one for each design"),
    ],
)
def test_a_table_that_is_wrong_says_where(wing, tmp_path, text, complaint):
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(InputError, match=complaint):
        sample(problem_of(wing), wing.model, Table(tmp_path / "table.csv"), tmp_path / "a.h5")
    assert not (tmp_path / "a.h5").exists()


def test_what_cannot_be_sampled_is_refused_before_a_file_is_made(wing, tmp_path, monkeypatch):
    file = tmp_path / "a.h5"
    with pytest.raises(InputError, match="no output 'CD'"):
        sample(problem_of(wing), wing.model, Sobol(2), file, outputs=["CD"])
    free = problem_of(wing, bound=1e31)
    with pytest.raises(InputError, match=r"twist\[0\] has no bounds"):
        sample(free, wing.model, Sobol(2), file)
    with pytest.raises(InputError, match="whole number"):
        Sobol(0)
    with pytest.raises(InputError, match="0 processes"):
        sample(problem_of(wing), wing.model, Sobol(2), file, processes=0)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10, 10, 1000))
    with pytest.raises(InputError, match="the disk has 1e-06 GB left"):
        sample(problem_of(wing), wing.model, Sobol(2), file)
    assert not file.exists()
    (tmp_path / "text.h5").write_text("no designs")
    with pytest.raises(InputError, match="cannot be read"):
        Designs(tmp_path / "text.h5")
