"""The Euler solver on ranks that are threads: what each makes of its cells is what one makes of all."""

from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from euler_cases import AXES, GRIDS, section_grid, sphere_quarters, with_guessed_patches
from rank_cases import on_ranks

from bspline_mdao import InputError
from bspline_mdao.base.numerics.halo import Halo
from bspline_mdao.flow.euler import factor_pattern
from bspline_mdao.flow.euler.adjoint import FlowTangent
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.forces import FlowForces
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.krylov import solve_refined
from bspline_mdao.flow.euler.newton import solve_flow
from bspline_mdao.flow.euler.preconditioner import compact_factor, time_terms
from bspline_mdao.flow.euler.sequencing import coarse_levels, states_from_coarse
from bspline_mdao.flow.euler.wall_forces import WallForces
from bspline_mdao.generators import FarField, Spacing, hh_wing_grid, onera_m6_grid, rectangular_wing
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.ownership import Ownership
from bspline_mdao.grids.topology.partition import Partition

STREAM = free_stream(0.3, 0.07, AXES)
KINDS = ("wall", "farfield", "symmetry")

for kind, name in ((FlowGrid, "pattern"), (FlowTangent, "factor"), (FlowTangent, "transposed_factor")):
    vars(kind)[name].lock = nullcontext()  # before Python 3.12 one rank has it while it waits for the others


@dataclass(frozen=True, eq=False)
class Parts:
    """A grid, and random numbers of its cells and nodes."""

    topology: object
    nodes: np.ndarray

    @classmethod
    def of(cls, grid, kinds=None):
        topology = find_topology(grid)
        if kinds:
            named = enumerate(topology.boundary)
            boundary = [replace(face, patch=f"p{n % 3}", kind=kinds[n % 3]) for n, face in named]
            topology = replace(topology, boundary=tuple(boundary))
        return cls(topology, grid.to_vector().reshape(-1, 3))

    @property
    def n_cells(self):
        return sum(int(np.prod([n - 1 for n in shape])) for shape in self.topology.shapes)

    def random(self, *shapes, seed=0):
        rng = np.random.default_rng(seed)
        return [rng.standard_normal(shape) for shape in shapes]

    def on(self, n, task):
        """Results of ``task(flow, subdomain)`` of every rank, with its subdomain."""
        partition = Partition.of(self.topology, n)
        subdomains = [partition.subdomain(rank) for rank in range(n)]

        def run(comm):
            subdomain = subdomains[comm.rank]
            flow = FlowGrid.of(self.topology, self.nodes[subdomain.rows], partition=partition, comm=comm)
            return task(flow, subdomain)

        return on_ranks(n, run), subdomains


@cache
def parts_of(name):
    return Parts.of(section_grid(7, 5)) if name == "section" else Parts.of(GRIDS[name](), KINDS)


def of_cells(results, subdomains, n_cells):
    """Rows of all cells, of those of every rank."""
    whole = np.full((n_cells, *results[0].shape[1:]), np.nan)
    for result, subdomain in zip(results, subdomains):
        whole[subdomain.cells] = result
    return whole


def of_nodes(results, subdomains, n_nodes):
    """Sums at all nodes, of those of every rank."""
    whole = np.zeros((n_nodes, 3))
    for result, subdomain in zip(results, subdomains):
        np.add.at(whole, subdomain.rows, result)
    return whole


def assert_same(ours, theirs, within=2e-14):
    assert np.abs(ours - theirs).max() <= within * np.abs(theirs).max()


@pytest.mark.parametrize("name", [*GRIDS, "section"])
@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_residual_and_products_of_ranks_are_those_of_one(name, n):
    parts = parts_of(name)
    cells, nodes = (parts.n_cells, 5), parts.nodes.shape
    noise, d_states, bar, d_nodes = parts.random(cells, cells, cells, nodes)
    states = STREAM * (1.0 + 0.03 * noise)

    def task(flow, subdomain):
        own, at = subdomain.cells, parts.nodes[subdomain.rows]
        areas, discretization = flow.areas(at), flow.discretization
        linearization = discretization.linearize(states[own], areas, STREAM)
        shifted = flow.areas_jvp(at, d_nodes[subdomain.rows])
        rows = (
            discretization.residual(states[own], areas, STREAM),
            linearization.state_jvp(d_states[own]),
            linearization.state_vjp(bar[own]),
            linearization.area_jvp(shifted) + linearization.stream_jvp(bar[0]),
            time_terms(discretization, states[own], areas),
            discretization.sizes(areas),
        )
        norms = discretization.norm(bar[own]), flow.extent(at)
        numbers = np.array([*linearization.stream_vjp(bar[own]), *norms, flow.least_height(at), flow.n_cells_of_grid])
        return rows, flow.areas_vjp(at, linearization.area_vjp(bar[own])), numbers

    results, subdomains = parts.on(n, task)
    ((rows, nodes_bar, numbers),), _ = parts.on(1, task)
    for k, theirs in enumerate(rows):
        assert_same(of_cells([result[0][k] for result in results], subdomains, parts.n_cells), theirs)
    assert_same(of_nodes([result[1] for result in results], subdomains, len(parts.nodes)), nodes_bar)
    for _, _, ours in results:
        np.testing.assert_allclose(ours, numbers, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(ours, results[0][2])


@cache
def wing():
    """A coarse half wing with walls, a far field and a plane of symmetry."""
    return Parts.of(with_guessed_patches(onera_m6_grid((7, 6, 5))))


@pytest.mark.parametrize("n", [1, 2, 4])
def test_forces_of_ranks_are_those_of_one_and_their_products_are_transposes(n):
    parts = wing()
    cells, nodes = (parts.n_cells, 5), parts.nodes.shape
    noise, d_states, shift, d_nodes, seeds = parts.random(cells, cells, nodes, nodes, (200,))
    states, moved = STREAM * (1.0 + 0.03 * noise), parts.nodes + 1e-4 * shift

    def task(flow, subdomain):
        forces = FlowForces.of(flow, parts.nodes[subdomain.rows], 1.16, 0.7, (0.1, 0.2, 0.3))
        at = states[subdomain.cells], moved[subdomain.rows], 0.1, 0.4
        along = d_states[subdomain.cells], d_nodes[subdomain.rows], 0.3, -0.2
        values, slopes = forces.evaluate(*at), forces.jvp(*at, *along)
        ends = np.cumsum([0, *(np.size(value) for value in values.values())])
        bars = {name: np.resize(seeds, ends[-1])[a:b] for name, a, b in zip(values, ends[:-1], ends[1:])}
        products = sum(np.sum(bars[name] * slopes[name]) for name in values)
        return values, slopes, products, forces.vjp(*at, bars), along

    results, subdomains = parts.on(n, task)
    ((values, slopes, product, bars, _),), _ = parts.on(1, task)
    for ours, our_slopes, our_product, *_ in results:
        for name in values:
            assert_same(np.asarray(ours[name]), np.asarray(values[name]), 1e-12)
            assert_same(np.asarray(our_slopes[name]), np.asarray(slopes[name]), 1e-11)
        np.testing.assert_allclose(our_product, product, rtol=1e-11)
    assert_same(of_cells([result[3][0] for result in results], subdomains, parts.n_cells), bars[0], 1e-12)
    assert_same(of_nodes([result[3][1] for result in results], subdomains, len(parts.nodes)), bars[1], 1e-12)
    for *_, (_, _, alpha_bar, mach_bar), _ in results:
        np.testing.assert_allclose([alpha_bar, mach_bar], [bars[2], bars[3]], rtol=1e-12)
    back = sum(np.sum(bar * d) for result in results for bar, d in zip(result[3][:2], result[4][:2]))
    np.testing.assert_allclose(back + 0.3 * bars[2] - 0.2 * bars[3], product, rtol=1e-10)


@pytest.mark.parametrize("n", [2, 3])
def test_forces_on_nodes_of_ranks_are_those_of_one(n):
    parts = wing()
    (noise,) = parts.random((parts.n_cells, 5))
    states = STREAM * (1.0 + 0.03 * noise)
    walls = FlowGrid.of(parts.topology, parts.nodes).walls.corners
    rows, quads = np.unique(walls[::2], return_inverse=True)

    def task(flow, subdomain):
        forces = WallForces.of(flow, quads.reshape(-1, 4), rows)
        return forces.evaluate(states[subdomain.cells], parts.nodes[subdomain.rows], 0.4, 7e3)

    (theirs,), _ = parts.on(1, task)
    for ours in parts.on(n, task)[0]:
        assert_same(ours, theirs, 1e-13)


@cache
def sphere():
    (grid,) = sphere_quarters([4])
    return Parts.of(grid)


def solved(flow, subdomain, start=None, parts=None):
    areas = flow.areas(parts.nodes[subdomain.rows])
    return solve_flow(flow.discretization, areas, STREAM, pattern=flow.pattern, tolerance=1e-12, states=start)


@cache
def sphere_alone():
    parts = sphere()
    (solution,), _ = parts.on(1, lambda flow, subdomain: solved(flow, subdomain, parts=parts))
    return solution


@pytest.mark.parametrize("n", [2, 3, 9])
def test_the_flow_on_ranks_is_that_on_one(n):
    parts = sphere()
    solutions, subdomains = parts.on(n, lambda flow, subdomain: solved(flow, subdomain, parts=parts))
    assert all(solution.is_converged for solution in solutions)
    assert len({solution.history for solution in solutions}) == 1
    states = of_cells([solution.states for solution in solutions], subdomains, parts.n_cells)
    assert_same(states, sphere_alone().states, 1e-10)


@pytest.mark.parametrize("is_transposed", [False, True])
def test_linear_systems_of_ranks_have_the_solution_of_one(is_transposed):
    parts, states = sphere(), sphere_alone().states
    (right,) = parts.random((parts.n_cells, 5), seed=4)

    def task(flow, subdomain):
        at, discretization = parts.nodes[subdomain.rows], flow.discretization
        linearization = discretization.linearize(states[subdomain.cells], flow.areas(at), STREAM)
        factor = compact_factor(linearization, flow.pattern, np.zeros((len(subdomain.cells), 5, 5)))
        product = linearization.state_vjp if is_transposed else linearization.state_jvp
        jacobians = linearization.jacobians
        rough = jacobians.transposed_product if is_transposed else jacobians.product
        precondition = (factor.into_transposed() if is_transposed else factor).solve
        solution = solve_refined(product, rough, precondition, right[subdomain.cells], 1e-12, comm=flow.comm)
        assert solution.is_converged
        return solution.x

    (theirs,), _ = parts.on(1, task)
    results, subdomains = parts.on(3, task)
    assert_same(of_cells(results, subdomains, parts.n_cells), theirs, 1e-9)


def preconditioned(parts, n, rows, diagonal):
    """Solutions with the preconditioner, and with its transpose, of rows of all cells on some ranks."""
    (noise,) = parts.random((parts.n_cells, 5), seed=2)
    states = STREAM * (1.0 + 0.03 * noise)

    def task(flow, subdomain):
        linearization = flow.discretization.linearize(
            states[subdomain.cells], flow.areas(parts.nodes[subdomain.rows]), STREAM
        )
        terms = time_terms(flow.discretization, states[subdomain.cells], linearization.areas)
        factor = compact_factor(linearization, flow.pattern, diagonal * terms)
        return factor.solve(rows[subdomain.cells]), factor.into_transposed().solve(rows[subdomain.cells])

    results, subdomains = parts.on(n, task)
    return [of_cells(of_ranks, subdomains, parts.n_cells) for of_ranks in zip(*results)]


@pytest.mark.parametrize("name", [*GRIDS, "section"])
@pytest.mark.parametrize("n", [2, 3, 5])
def test_the_preconditioner_of_ranks_and_its_transpose_agree(name, n):
    parts = parts_of(name)
    a, b = parts.random(*2 * [(parts.n_cells, 5)], seed=3)
    forward, back = preconditioned(parts, n, a, 0.3)[0], preconditioned(parts, n, b, 0.3)[1]
    size = np.linalg.norm(forward) * np.linalg.norm(b)
    assert np.vdot(forward, b) == pytest.approx(np.vdot(a, back), abs=1e-5 * size)


@pytest.mark.slow
def test_with_all_fill_the_preconditioner_of_two_ranks_is_that_of_one(monkeypatch):
    parts = sphere()
    monkeypatch.setattr(factor_pattern, "smallest_entry", lambda n_cells: 0.0)
    (rows,) = parts.random((parts.n_cells, 5), seed=3)
    for ours, theirs in zip(preconditioned(parts, 2, rows, 0.01), preconditioned(parts, 1, rows, 0.01)):
        assert np.linalg.norm(ours - theirs) < 0.02 * np.linalg.norm(theirs)  # numbers are kept to 8 bits


@pytest.mark.parametrize("n", [1, 3])
def test_fill_is_by_the_cells_of_all_ranks(monkeypatch, n):
    parts, sizes = sphere(), []
    monkeypatch.setattr(factor_pattern, "smallest_entry", lambda n_cells: sizes.append(n_cells) or 0.01)
    parts.on(n, lambda flow, subdomain: flow.pattern)
    assert sizes == n * [parts.n_cells]


@cache
def refined_wing():
    """A half wing in twelve blocks, 5,376 cells."""
    spacing = Spacing(off_wall=5e-3, leading=5e-3, trailing=5e-3, tip=5e-3)
    return Parts.of(hh_wing_grid(rectangular_wing(), (9, 9, 8), spacing, FarField(10.0)))


@cache
def products_on(n):
    """Products that a flow and an adjoint take on some ranks."""
    parts = refined_wing()
    (right,) = parts.random((parts.n_cells, 5), seed=4)

    def task(flow, subdomain):
        areas = flow.areas(parts.nodes[subdomain.rows])
        solution = solve_flow(flow.discretization, areas, STREAM, pattern=flow.pattern)
        tangent = FlowTangent.of(flow.discretization, solution.states, areas, STREAM, flow.pattern)
        system = tangent.solve_transposed(right[subdomain.cells], 1e-10)
        assert solution.is_converged
        assert system.is_converged
        return sum(step.n_products for step in solution.history), system.n_products

    return parts.on(n, task)[0][0]


@pytest.mark.slow
@pytest.mark.parametrize(("n", "most"), [(2, 1.2), (4, 1.4)])
def test_flows_and_adjoints_take_few_more_products_on_ranks_than_on_one(n, most):
    for ours, theirs in zip(products_on(n), products_on(1)):
        assert ours <= most * theirs


@pytest.mark.parametrize("n", [2, 3, 5])
def test_a_start_on_coarser_members_of_ranks_is_that_of_one(n):
    parts = sphere()

    def start(flow, subdomain):
        partition = Partition.of(parts.topology, flow.comm.size)
        nodes = parts.nodes[subdomain.rows]
        levels = coarse_levels(parts.topology, nodes, 2, partition=partition, comm=flow.comm)
        return states_from_coarse(levels, nodes, STREAM), [level.pick(nodes) for level in levels[:1]]

    ((theirs, _),), _ = parts.on(1, start)
    results, subdomains = parts.on(n, start)
    assert_same(of_cells([result[0] for result in results], subdomains, parts.n_cells), theirs, 1e-2)  # solved to 1e-3


@pytest.mark.parametrize("n", [1, 2, 4])
def test_coarser_members_pick_the_same_nodes_and_parents_on_any_number_of_ranks(n):
    parts = wing()

    def task(flow, subdomain):
        partition = Partition.of(parts.topology, flow.comm.size)
        (level,) = coarse_levels(parts.topology, parts.nodes[subdomain.rows], 1, partition=partition, comm=flow.comm)
        areas = level.flow.areas(level.pick(parts.nodes[subdomain.rows]))
        return level.spread(level.flow.discretization.sizes(areas))

    (theirs,), _ = parts.on(1, task)
    results, subdomains = parts.on(n, task)
    assert_same(of_cells(results, subdomains, parts.n_cells), theirs)


def test_negative_volumes_are_named_on_all_ranks_by_block_and_cell():
    parts = wing()
    partition = Partition.of(parts.topology, 3)
    moved = parts.nodes.copy()
    moved[partition.subdomain(1).rows[40:60]] += 50.0

    def task(flow, subdomain):
        with pytest.raises(InputError, match=r"negative volumes, the worst .* in block \d+, cell") as failure:
            flow.require_volumes(moved[subdomain.rows])
        return str(failure.value)

    words, _ = parts.on(3, task)
    assert len(set(words)) == 1


@pytest.mark.parametrize("n", [2, 3, 5])
def test_what_is_seen_of_others_goes_back_to_them(n):
    """Random rows of random owners, some wanted twice or one's own; a rank has none."""
    rng = np.random.default_rng(n)
    sizes = [*rng.integers(3, 9, n - 1), 0]
    wanted = [rng.integers(0, n - 1, 12) for _ in range(n)]
    rows = [np.array([rng.integers(0, sizes[rank]) for rank in ranks]) for ranks in wanted]
    own = [rng.standard_normal((size, 2)) for size in sizes]

    def task(comm):
        halo, places = Halo.of(comm, sizes[comm.rank], wanted[comm.rank], rows[comm.rank])
        seen = halo.extend(own[comm.rank])
        np.testing.assert_array_equal(seen[places], [own[a][b] for a, b in zip(wanted[comm.rank], rows[comm.rank])])
        np.testing.assert_array_equal(halo.cut(seen), own[comm.rank])
        assert halo.n_ghosts == len({(a, b) for a, b in zip(wanted[comm.rank], rows[comm.rank]) if a != comm.rank})
        bar = np.random.default_rng(comm.rank).standard_normal(seen.shape)
        return np.sum(bar * seen), np.sum(halo.fold(bar) * own[comm.rank])

    forward, back = np.sum(on_ranks(n, task), axis=0)
    np.testing.assert_allclose(forward, back, rtol=1e-13)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_holders_find_what_the_subdomains_list(n):
    topology = wing().topology
    partition = Partition.of(topology, n)
    nodes, cells = Ownership.of_nodes(partition), Ownership.of_cells(partition)
    seen = np.zeros(topology.n_nodes, bool)
    for rank in range(n):
        subdomain = partition.subdomain(rank)
        ranks, rows = cells.find(subdomain.cells)
        assert (ranks == rank).all()
        np.testing.assert_array_equal(rows, np.arange(len(subdomain.cells)))
        ranks, rows = nodes.find(subdomain.rows)
        np.testing.assert_array_equal(ranks == rank, ~seen[subdomain.rows])
        seen[subdomain.rows] = True
        np.testing.assert_array_equal(rows[ranks == rank], np.flatnonzero(ranks == rank))
