"""Geometry, grid movement and flow take their roles in MPhys, with other solvers and with each other."""

import warnings
from types import SimpleNamespace

import numpy as np
import openmdao.api as om
import pytest
from openmdao.utils.assert_utils import assert_check_partials

from bspline_mdao import GridMovement, InputError, fit_grid
from bspline_mdao.design import Parametrization, ReferenceAxis, Span, Twist
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.topology.sharing import node_sharing, numbers_of_points, rows_of_points
from bspline_mdao.measures import EnclosedVolume, SurfaceGrid
from bspline_mdao.movers import InverseDistance, moving_mesh

mphys = pytest.importorskip("mphys", reason="MPhys is not installed")

from mphys.scenarios import ScenarioAerodynamic  # noqa: E402

from bspline_mdao.core.om.mphys.geometry import GeometryBuilder, SurfaceGeometry  # noqa: E402
from bspline_mdao.core.om.mphys.warper import VolumeWarper  # noqa: E402
from bspline_mdao.core.om.surface_control import SurfaceControl  # noqa: E402
from bspline_mdao.core.om.surface_evaluate import SurfaceEvaluate  # noqa: E402
from bspline_mdao.flow.om.mphys.builders import (  # noqa: E402
    EULER_RESULTS,
    FLOW_RESULTS,
    EulerBuilder,
    FlowBuilder,
)

DESIGN = {"twist": [1.0, -2.0, 3.0], "span": [1.1]}
CONDITIONS = {"angle_of_attack": 3.0, "mach_number": 0.4}


@pytest.fixture(scope="module")
def wing():
    return small_wing((9, 8, 7))


def small_wing(shape):
    """A small wing, its variables and its mover."""
    model = fit_grid(onera_m6_grid(shape))
    mesh = moving_mesh(model)
    axis = ReferenceAxis.of(mesh)
    parametrization = Parametrization(mesh, [Twist("twist", axis, stations=3), Span("span", axis)])
    return SimpleNamespace(
        model=model, surface=SurfaceGrid.of(model), parametrization=parametrization, mover=InverseDistance(mesh)
    )


class Forces(om.ExplicitComponent):
    """Pressures of a made-up flow on the wall, integrated: what a flow group hands out, of all that it is handed."""

    def initialize(self):
        self.options.declare("surface")

    def setup(self):
        self.add_input("grid", shape=self.options["surface"].points.size, units="m")
        self.add_input("alpha", 0.0, units="deg")
        self.add_input("Mach_number", 0.3)
        for name, shape in (("CL", 1), ("CD", 1), ("CM", 3), ("CD_induced", 1)):
            self.add_output(name, shape=shape)
        self.add_output("span_load", shape=4, units="m")
        self.declare_partials("*", "*", method="cs")

    def compute(self, inputs, outputs):
        surface, angle = self.options["surface"], inputs["alpha"].item() * np.pi / 180.0
        corners = inputs["grid"].reshape(-1, 3)[surface.quads]
        centres = corners.mean(axis=1)
        areas = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        pressures = np.sin(centres @ [2.0, 7.0, 1.0] - 3.0 * angle) / np.sqrt(1.0 - inputs["Mach_number"] ** 2)
        forces = -pressures[:, None] * areas
        outputs["CL"] = forces.sum(axis=0) @ [-np.sin(angle), np.cos(angle), 0.0]
        outputs["CD"] = forces.sum(axis=0) @ [np.cos(angle), np.sin(angle), 0.0]
        outputs["CM"] = np.cross(centres, forces).sum(axis=0)
        outputs["CD_induced"] = outputs["CL"] ** 2
        outputs["span_load"] = forces[:4, 1]


def fake_flow(wing):
    """A group with the interface of our flow groups."""
    group, walls = om.Group(), (3 * wing.surface.rows[:, None] + [0, 1, 2]).ravel()
    group.add_subsystem("forces", Forces(surface=wing.surface), promotes_inputs=["alpha", "Mach_number"])
    group.promotes("forces", inputs=["grid"], src_indices=walls, src_shape=3 * wing.model.n_nodes)
    group.promotes("forces", outputs=["*"])
    return group


def flow_builder(wing):
    return FlowBuilder(wing.model, lambda: fake_flow(wing), surface=wing.surface, mover=wing.mover)


class Cruise(mphys.Multipoint):
    """A study with MPhys as its documentation has it: mesh, geometry, scenario, connected by the names of MPhys."""

    def initialize(self):
        self.options.declare("builder", recordable=False)
        self.options.declare("geometry", recordable=False)

    def setup(self):
        builder = self.options["builder"]
        builder.initialize(self.comm)
        self.add_subsystem("mesh", builder.get_mesh_coordinate_subsystem())
        self.add_subsystem("geometry", self.options["geometry"], promotes_inputs=list(DESIGN))
        self.mphys_add_scenario("cruise", ScenarioAerodynamic(aero_builder=builder))
        self.connect("mesh.x_aero0_mesh", "geometry.x_aero0_geometry_input")
        self.connect("geometry.x_aero0_geometry_output", "cruise.x_aero")


def run(problem, mode="auto", **values):
    problem.setup(mode=mode)
    for name, value in values.items():
        problem.set_val(name, value)
    problem.run_model()
    return problem


def conditions():
    return {f"cruise.{name}": value for name, value in CONDITIONS.items()}


def cruise(wing, mode="auto", builder=None, **geometry):
    geometry = SurfaceGeometry(model=wing.model, parametrization=wing.parametrization, surface=wing.surface, **geometry)
    problem = om.Problem(Cruise(builder=builder or flow_builder(wing), geometry=geometry), reports=False)
    return run(problem, mode, **DESIGN, **conditions())


def direct_chain(wing):
    """The same study without MPhys: nodes of the deformed surface, and the grid that meets them."""
    problem = om.Problem(reports=False)
    geometry = problem.model.add_subsystem(
        "geometry", om.Group(), promotes_inputs=[*DESIGN], promotes_outputs=["surface"]
    )
    geometry.add_subsystem("control", SurfaceControl(parametrization=wing.parametrization), promotes=["*"])
    nodes = SurfaceEvaluate(model=wing.model, mesh=wing.mover.mesh, surface=wing.surface)
    geometry.add_subsystem("nodes", nodes, promotes=["*"])
    movement = GridMovement(model=wing.model, mover=wing.mover, surface=wing.surface, fit=False)
    problem.model.add_subsystem("movement", movement, promotes=["*"])
    problem.model.add_subsystem("flow", fake_flow(wing), promotes=["*"])
    return run(problem, **DESIGN, alpha=CONDITIONS["angle_of_attack"], Mach_number=CONDITIONS["mach_number"])


@pytest.mark.slow
def test_a_scenario_gives_the_grid_and_the_forces_of_the_chain_without_mphys(wing):
    problem, direct = cruise(wing), direct_chain(wing)
    np.testing.assert_allclose(problem.get_val("cruise.aero_vol_coords"), direct.get_val("grid"), atol=1e-12)
    for name in FLOW_RESULTS:
        np.testing.assert_allclose(problem.get_val(f"cruise.{name}"), direct.get_val(name), rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_a_scenario_promotes_the_names_of_mphys(wing):
    scenario = cruise(wing).model.cruise
    variables = mphys.MPhysVariables.Aerodynamics
    promoted = {meta["prom_name"] for meta in scenario.get_io_metadata().values()}
    conditions = variables.FlowConditions
    assert {
        *(variables.Surface.COORDINATES, variables.Surface.COORDINATES_INITIAL, "aero_vol_coords"),
        *(conditions.ANGLE_OF_ATTACK, conditions.MACH_NUMBER),
        *FLOW_RESULTS,
    } <= promoted


TOTALS = (["cruise.CL", "cruise.CD", "cruise.CM", "cruise.span_load"], [*DESIGN, *conditions()])


@pytest.mark.slow
def test_totals_of_a_scenario_agree_forward_and_reverse(wing):
    forward, reverse = (cruise(wing, mode).compute_totals(*TOTALS) for mode in ("fwd", "rev"))
    for key, total in forward.items():
        np.testing.assert_allclose(total, reverse[key], rtol=1e-12, atol=1e-12 * np.abs(total).max())


def slopes(problem, of, wrt, direction, step=1e-3):
    """Central differences of outputs along a direction, extrapolated to fourth order."""
    value, found = problem.get_val(wrt).copy(), []
    for h in (step, -step, 0.5 * step, -0.5 * step):
        problem.set_val(wrt, value + h * direction)
        problem.run_model()
        found.append(np.concatenate([problem.get_val(name).ravel() for name in of]))
    problem.set_val(wrt, value)
    coarse, fine = (found[0] - found[1]) / (2.0 * step), (found[2] - found[3]) / step
    return (4.0 * fine - coarse) / 3.0


def assert_totals_are_slopes(problem, of, wrt):
    totals = problem.compute_totals(of, wrt)
    for name in wrt:
        direction = np.random.default_rng(5).normal(size=problem.get_val(name).shape)
        exact = np.concatenate([totals[output, name] @ direction for output in of])
        scale = np.abs(exact).max()
        np.testing.assert_allclose(exact, slopes(problem, of, name, direction), rtol=1e-7, atol=1e-9 * scale)


@pytest.mark.slow
def test_totals_of_a_scenario_are_those_of_differences_extrapolated(wing):
    assert_totals_are_slopes(cruise(wing), *TOTALS)


@pytest.mark.slow
def test_totals_of_a_scenario_are_those_of_the_chain_without_mphys(wing):
    totals = cruise(wing).compute_totals(["cruise.CL"], list(DESIGN))
    for (_, name), expected in direct_chain(wing).compute_totals(["CL"], list(DESIGN)).items():
        np.testing.assert_allclose(totals["cruise.CL", name], expected, rtol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("component", ["geometry.place", "cruise.aero_pre.surface", "cruise.coupling.results"])
def test_partials_of_linear_components_are_those_of_differences(wing, component):
    problem = cruise(wing)
    checked = problem.check_partials(includes=component, form="central", step=1.0, out_stream=None)
    assert_check_partials(checked, atol=1e-9, rtol=1e-9)


def test_nothing_of_ours_warns_in_one_process(wing):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cruise(wing).compute_totals(["cruise.CL"], ["twist"])


@pytest.mark.slow
def test_the_euler_equations_fly_a_scenario_with_exact_totals():
    wing = small_wing((7, 6, 5))
    builder = EulerBuilder(wing.model, surface=wing.surface, mover=wing.mover, reference_area=0.75)
    problem, of = cruise(wing, "rev", builder), ["cruise.CL", "cruise.CD_induced"]
    assert set(EULER_RESULTS) <= {meta["prom_name"] for meta in problem.model.cruise.get_io_metadata("output").values()}
    direction = np.array([1.0, 2.0, -1.0])
    totals = problem.compute_totals(of, ["twist"])
    exact = [(totals[name, "twist"] @ direction).item() for name in of]
    np.testing.assert_allclose(exact, slopes(problem, of, "twist", direction, step=0.02), rtol=1e-5)


class ForeignMesh(om.ExplicitComponent):
    """Surface nodes as a foreign solver holds them."""

    def initialize(self):
        self.options.declare("nodes")

    def setup(self):
        nodes = self.options["nodes"]
        self.add_output("x_aero0_mesh", val=nodes, distributed=True, tags=["mphys_coordinates"])


class ForeignSolver(om.ExplicitComponent):
    """Sum of a function of all coordinates, each with a weight by its place: notices every node out of order."""

    def setup(self):
        self.add_input("adflow_vol_coords", distributed=True, shape_by_conn=True, tags=["mphys_coupling"])
        self.add_input("alpha", 1.0, units="deg", tags=["mphys_input"])
        self.add_output("cl", tags=["mphys_result"])
        self.declare_partials("*", "*")

    def compute(self, inputs, outputs):
        nodes = inputs["adflow_vol_coords"]
        outputs["cl"] = inputs["alpha"] * (np.sin(np.arange(nodes.size)) @ np.sin(nodes))

    def compute_partials(self, inputs, partials):
        nodes = inputs["adflow_vol_coords"]
        weights = np.sin(np.arange(nodes.size))
        partials["cl", "adflow_vol_coords"] = inputs["alpha"] * weights * np.cos(nodes)
        partials["cl", "alpha"] = weights @ np.sin(nodes)


class ForeignBuilder(mphys.Builder):
    """Another project's builder: nodes block after block with i fastest, in single precision, those shared repeated."""

    def __init__(self, wing):
        self.order = np.concatenate([rows.transpose(2, 1, 0).ravel() for rows in wing.model.topology.layout.numbers])
        self.volume = np.float32(wing.model.regenerate().to_vector().reshape(-1, 3)[self.order])
        walls = np.concatenate([face[:, ::-1].T.ravel() for face in wing.surface.faces])
        self.surface = np.float32(wing.surface.points[walls])

    def get_mesh_coordinate_subsystem(self, scenario_name=None):
        return ForeignMesh(nodes=np.float64(self.surface).ravel())

    def get_coupling_group_subsystem(self, scenario_name=None):
        return ForeignSolver()


class WarpedBuilder(ForeignBuilder):
    """The same with our grid movement in the place of its own: all that there is to write."""

    def __init__(self, wing):
        super().__init__(wing)
        self.wing = wing

    def get_pre_coupling_subsystem(self, scenario_name=None):
        model, surface = self.wing.model, self.wing.surface
        return VolumeWarper(
            model=model,
            mover=self.wing.mover,
            numbers=numbers_of_points(surface.points, self.surface, "surface"),
            rows=rows_of_points(model.regenerate(), model.topology, self.volume),
            volume_name="adflow_vol_coords",
        )


@pytest.fixture
def foreign(wing):
    """A study with a foreign solver."""
    builder = WarpedBuilder(wing)
    geometry = SurfaceGeometry(
        model=wing.model,
        parametrization=wing.parametrization,
        numbers=numbers_of_points(wing.surface.points, builder.surface, "surface"),
    )
    return builder, lambda: om.Problem(Cruise(builder=builder, geometry=geometry), reports=False)


@pytest.mark.filterwarnings("ignore::openmdao.api.DistributedComponentWarning")
def test_a_foreign_solver_is_handed_its_own_nodes_in_its_own_order(wing, foreign):
    builder, problem = foreign
    problem = run(problem(), **DESIGN)
    moved = direct_chain(wing).get_val("grid").reshape(-1, 3)
    handed = problem.get_val("cruise.adflow_vol_coords").reshape(-1, 3)
    np.testing.assert_allclose(handed, moved[builder.order], atol=1e-6)  # its nodes are in single precision
    assert np.abs(handed - builder.volume).max() > 0.05


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::openmdao.api.DistributedComponentWarning")
def test_totals_of_a_foreign_solver_agree_forward_and_reverse_and_with_differences(foreign):
    totals = [run(foreign[1](), mode, **DESIGN).compute_totals(["cruise.cl"], list(DESIGN)) for mode in ("fwd", "rev")]
    for key, total in totals[0].items():
        np.testing.assert_allclose(total, totals[1][key], rtol=1e-11)
    assert_totals_are_slopes(run(foreign[1](), **DESIGN), ["cruise.cl"], list(DESIGN))


class Parallel(mphys.MultipointParallel):
    """Scenarios that MPhys connects by itself, each with its own mesh and geometry."""

    def initialize(self):
        self.options.declare("scenarios", recordable=False)

    def setup(self):
        for name, (builder, geometry) in self.options["scenarios"].items():
            scenario = ScenarioAerodynamic(aero_builder=builder, geometry_builder=geometry, in_MultipointParallel=True)
            self.mphys_add_scenario(name, scenario)


@pytest.mark.slow
def test_parallel_scenarios_are_connected_by_mphys_itself(wing):
    geometry = GeometryBuilder(model=wing.model, parametrization=wing.parametrization)
    scenarios = {name: (flow_builder(wing), geometry) for name in ("cruise", "climb")}
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("points", Parallel(scenarios=scenarios), promotes=["*"])
    values = {f"cruise.geometry.{name}": value for name, value in DESIGN.items()}
    run(problem, **values, **conditions(), **{"climb.mach_number": 0.2})
    assert problem.get_val("cruise.CL") == pytest.approx(cruise(wing).get_val("cruise.CL"), rel=1e-10)
    assert problem.get_val("climb.CL") != pytest.approx(problem.get_val("cruise.CL"), rel=1e-2)


def test_a_solver_gets_its_own_surface_back_from_variables_that_move_nothing(wing):
    problem = om.Problem(reports=False)
    geometry = SurfaceGeometry(model=wing.model, parametrization=wing.parametrization, numbers=[5, 3, 3, 8])
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    nodes = wing.surface.points[[5, 3, 3, 8]] + 1e-6 * np.random.default_rng(6).normal(size=(4, 3))
    run(problem, x_aero0_geometry_input=nodes.ravel())
    np.testing.assert_allclose(problem.get_val("x_aero0_geometry_output"), nodes.ravel(), atol=1e-14)


def test_the_geometry_measures_its_surface(wing):
    problem = cruise(wing, measures=[EnclosedVolume.of(wing.surface)])
    direct = EnclosedVolume.of(wing.surface).evaluate(problem.get_val("geometry.surface").reshape(-1, 3))
    np.testing.assert_allclose(problem.get_val("geometry.volume"), direct, rtol=1e-12)
    assert direct > 1.05 * EnclosedVolume.of(wing.surface).evaluate(wing.surface.points)


def warped(wing, nodes, **options):
    """A warper by itself, run with the solver's nodes."""
    problem = om.Problem(reports=False)
    warper = VolumeWarper(model=wing.model, mover=wing.mover, **options)
    problem.model.add_subsystem("warper", warper, promotes=["*"])
    return run(problem, x_aero=nodes.ravel())


def test_the_far_field_of_a_warper_goes_along_where_that_is_asked(wing):
    nodes = wing.surface.points + [0.3, 0.1, 0.0]  # along the plane of symmetry
    grid = wing.model.regenerate().to_vector().reshape(-1, 3)
    moved = [warped(wing, nodes, comoving=is_asked).get_val("aero_vol_coords") for is_asked in (False, True)]
    np.testing.assert_allclose(moved[1].reshape(-1, 3) - grid, np.broadcast_to([0.3, 0.1, 0.0], grid.shape), atol=1e-11)
    assert np.abs(moved[0] - moved[1]).max() > 0.1


def kinked(wing, angle=10.0):
    """Nodes of the wing with its outer half turned up, as no control points can have it, and some noise."""
    nodes, slope = wing.surface.points.copy(), np.tan(np.deg2rad(angle))
    nodes[:, 1] += slope * np.maximum(nodes[:, 2] - 0.6, 0.0)
    noise = 1e-4 * np.random.default_rng(7).normal(size=nodes.shape)
    for ids, normal in wing.surface.on_planes(wing.model):
        noise[ids] -= np.outer(noise[ids] @ normal, normal)
    return nodes + noise


def test_every_node_of_a_solver_is_met_whatever_the_surface(wing):
    nodes = kinked(wing)
    problem = warped(wing, nodes)
    grid = problem.get_val("aero_vol_coords").reshape(-1, 3)
    np.testing.assert_allclose(grid[wing.surface.rows], nodes, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(grid, grid[node_sharing(wing.model.topology).source_rows()])
    quality = GridQuality.of_baseline(wing.model.regenerate())
    assert all(cells.is_valid.all() for cells in quality.cells(grid))
    assert problem.model.warper.miss.largest > 1e-3


def test_nodes_that_a_solver_does_not_give_follow_the_control_points(wing):
    rng, nodes = np.random.default_rng(8), kinked(wing)
    numbers = rng.permutation(np.arange(len(nodes)))[len(nodes) // 8 :]
    numbers = np.concatenate([numbers, numbers[:5]])
    grid = warped(wing, nodes[numbers], numbers=numbers).get_val("aero_vol_coords").reshape(-1, 3)
    walls = grid[wing.surface.rows]
    np.testing.assert_allclose(walls[numbers], nodes[numbers], rtol=0, atol=1e-12)
    left = np.setdiff1d(np.arange(len(nodes)), numbers)
    assert 1e-6 < np.abs(walls - nodes)[left].max() < 0.02


def test_of_a_node_that_is_given_twice_the_mean_counts(wing):
    numbers = np.append(np.arange(wing.surface.n_points), 3)
    nodes = wing.surface.points[numbers]
    nodes[-1] += [0.002, 0.0, 0.0]
    walls = warped(wing, nodes, numbers=numbers).get_val("aero_vol_coords").reshape(-1, 3)[wing.surface.rows]
    np.testing.assert_allclose(walls[3], wing.surface.points[3] + [0.001, 0.0, 0.0], rtol=0, atol=1e-12)


def test_nodes_that_leave_a_plane_of_symmetry_are_an_analysis_error(wing):
    with pytest.raises(om.AnalysisError, match=r"point \d+ of 'surface' leaves its plane of symmetry by 0.01 m"):
        warped(wing, wing.surface.points + [0.0, 0.0, 0.01])


@pytest.mark.slow
def test_totals_of_nodes_that_no_spline_has_are_those_of_differences(wing):
    problem = warped(wing, kinked(wing))
    rng, nodes = np.random.default_rng(9), problem.get_val("x_aero").copy()
    direction = rng.normal(size=nodes.shape).reshape(-1, 3)
    for ids, normal in wing.surface.on_planes(wing.model):
        direction[ids] -= np.outer(direction[ids] @ normal, normal)
    exact = problem.compute_totals(["aero_vol_coords"], ["x_aero"])["aero_vol_coords", "x_aero"] @ direction.ravel()
    differences = slopes(problem, ["aero_vol_coords"], "x_aero", direction.ravel(), step=1e-5)
    np.testing.assert_allclose(exact, differences, rtol=0, atol=1e-8 * np.abs(exact).max())


def test_the_warper_tells_how_far_control_points_alone_miss_the_nodes(wing, caplog):
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("warper", VolumeWarper(model=wing.model, mover=wing.mover), promotes=["*"])
    problem.setup()
    assert problem.model.warper.miss is None
    for nodes, least, most in ((wing.surface.points, 0.0, 1e-14), (kinked(wing), 1e-3, 0.1)):
        problem.set_val("x_aero", nodes.ravel())
        caplog.clear()
        with caplog.at_level("INFO", logger="bspline_mdao.core.fit.surface_fit"):
            problem.run_model()
        miss = problem.model.warper.miss
        assert least <= miss.largest <= most
        (record,) = caplog.records
        assert record.levelname == "INFO"
        assert "fit_surface" in record.getMessage()
        assert str(miss) in record.getMessage()


def test_surface_nodes_that_are_not_finite_are_an_analysis_error(wing):
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("warper", VolumeWarper(model=wing.model, mover=wing.mover), promotes=["*"])
    with pytest.raises(om.AnalysisError, match=r"x_aero\[0\], x of point 1, is nan"):
        run(problem, x_aero=np.full(wing.surface.points.size, np.nan))


@pytest.mark.parametrize("numbers", [[0, 10_000], [0.5], [[1, 2]], [], [-1]])
def test_numbers_of_nodes_that_are_not_there_are_refused(wing, numbers):
    problem = om.Problem(reports=False)
    geometry = SurfaceGeometry(model=wing.model, parametrization=wing.parametrization, numbers=numbers)
    problem.model.add_subsystem("geometry", geometry)
    with pytest.raises(InputError, match="'numbers' are not numbers of nodes; give a list of integers from 0 to"):
        problem.setup()
