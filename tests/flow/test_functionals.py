"""The table of the flow's functionals: every row is computed, differentiated, declared and documented."""

from functools import cache

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, LatticeFlow, fit_grid
from bspline_mdao.core.measures.camber_surface import CamberSurface
from bspline_mdao.core.mesh.surface import SurfaceGrid
from bspline_mdao.flow.euler import forces as of_states
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.forces import FlowForces
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.functionals import FUNCTIONALS, numbers, of_flow
from bspline_mdao.flow.loads import wing_coefficients as of_wings
from bspline_mdao.flow.om.euler_flow import EulerForces
from bspline_mdao.flow.om.lattice_flow import LatticeForces
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.studio.study.keys import FLOWS


@cache
def flow():
    """Forces on an M6 wing of 1,536 cells; states and nodes near those of the free stream and the baseline."""
    model = fit_grid(onera_m6_grid((7, 5, 5)))
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    grid, rng = FlowGrid.of(model.topology, nodes), np.random.default_rng(0)
    states = grid.discretization.uniform(free_stream(0.4, 0.1, grid.axes))
    states = states * rng.uniform(0.8, 1.2, states.shape)
    return (
        model,
        grid,
        FlowForces.of(grid, nodes, 1.16, 0.7, (0.3, 0.1, -0.2)),
        (
            states,
            nodes + 1e-3 * rng.standard_normal(nodes.shape),
            0.1,
            0.4,
        ),
    )


@cache
def derivatives():
    """A direction in all arguments, the derivatives along it, and those of a complex step."""
    *_, forces, at = flow()
    rng = np.random.default_rng(1)
    along = [rng.standard_normal(np.shape(value)) if np.ndim(value) else rng.standard_normal() for value in at]
    stepped = forces.evaluate(*(a + 1e-30j * d for a, d in zip(at, along)))
    return along, forces.jvp(*at, *along), {name: np.imag(value) / 1e-30 for name, value in stepped.items()}


@pytest.mark.parametrize("name", of_flow("euler"))
def test_every_functional_has_exact_derivatives_both_ways(name):
    *_, forces, at = flow()
    along, changes, exact = derivatives()
    change = np.asarray(changes[name])
    np.testing.assert_allclose(change, exact[name], rtol=1e-10, atol=1e-12 * np.abs(exact[name]).max())
    bar = np.random.default_rng(2).standard_normal(change.shape)
    reverse = sum(np.sum(np.asarray(back) * d) for back, d in zip(forces.vjp(*at, {name: bar}), along))
    assert abs(np.sum(bar * change)) > 1e-8
    assert reverse == pytest.approx(np.sum(bar * change), rel=1e-11)


def test_every_row_is_computed_by_the_kernel_that_it_names():
    *_, forces, _ = flow()
    made = {**of_wings.KERNELS, **of_states.KERNELS}
    assert {row.kernel for row in FUNCTIONALS.values()} == {*made, "pressure"}
    computed = [name for kernel in (*forces.wing.kernels, *forces.kernels) for name in kernel.outputs]
    assert sorted(computed) == sorted(name for name, row in of_flow("euler").items() if row.kernel != "pressure")


@pytest.mark.parametrize("kind", ["euler", "lattice"])
def test_components_declare_the_rows_of_their_flow_with_shapes_and_units(kind):
    model, grid, forces, (_, nodes, *_) = flow()
    if kind == "euler":
        component = EulerForces(flow=grid, nodes=nodes, forces=forces)
        shapes = {"strips": (forces.wing.induced.strips.n_strips,), "faces": (len(grid.walls.corners),)}
    else:
        component = LatticeForces(camber=CamberSurface.of(SurfaceGrid.of(model), 3, 5), reference_area=1.16)
        shapes = {"strips": (4,), "panels": (2, 4)}
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("flow", component)
    problem.setup()
    found = component.get_io_metadata("output", metadata_keys=("shape", "units"))
    shapes |= {"number": (1,), "axes": (3,)}
    assert {name: (meta["shape"], meta["units"]) for name, meta in found.items()} == {
        name: (shapes[row.extent], row.units) for name, row in of_flow(kind).items()
    }


@pytest.mark.parametrize(("kind", "flow_kind"), [(EulerFlow, "euler"), (LatticeFlow, "lattice")])
def test_docstrings_list_the_rows_of_their_flow_below_the_rule_of_their_table(kind, flow_kind):
    rule = next(line for line in kind.__doc__.splitlines() if line.strip().startswith("===="))
    start = rule.rfind(" ") + 1
    for name, row in of_flow(flow_kind).items():
        line = next(line for line in kind.__doc__.splitlines() if line.startswith(f"    ``{name}``"))
        assert row.meaning.startswith(line[start:])
        assert len(line) <= len(rule)


def test_studies_take_what_is_one_number():
    for kind, found in FLOWS.items():
        assert found.outputs == numbers(kind) == tuple(name for name in of_flow(kind) if FUNCTIONALS[name].is_number)
    assert "CD_entropy" not in numbers("lattice")
    assert numbers("euler", "drag") == ("CD", "CD_induced", "CD_entropy")
