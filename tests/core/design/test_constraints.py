from dataclasses import replace

import numpy as np
import pytest
from mover_cases import both_sides, channel, channel_grid, mesh_of, oblique_channel, plate, wing
from scipy.linalg import null_space
from scipy.sparse import csr_array, vstack
from topology_cases import ORIENTATIONS, box, grid_of, o_grid, patch, split

from bspline_mdao.base.numerics.vectors import nearest_plane
from bspline_mdao.core.design.elimination import Equations, eliminate
from bspline_mdao.core.design.linear_constraints import (
    EqualDisplacement,
    InPlane,
    Linked,
    Mirrored,
    Opposite,
    Pinned,
)
from bspline_mdao.core.design.selection import InBox, NearPlane, SurfaceRows
from bspline_mdao.core.design.tangent_continuity import TangentContinuity
from bspline_mdao.core.mesh.seams import seams_of_mesh
from bspline_mdao.errors import InputError
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.index_space import Window

OBLIQUE = np.array([0.6, -0.3, 0.74])


def surface_of(mesh):
    return mesh.points[mesh.surface_ids]


def displaced(mesh, *constraints, seed=0):
    """Elimination, and random displacements before and after it, shape (n_surface, 3)."""
    elimination = eliminate(mesh, surface_of(mesh), constraints)
    d = np.random.default_rng(seed).normal(size=(len(mesh.surface_ids), 3))
    return elimination, d, (elimination.matrix @ d.ravel()).reshape(-1, 3)


def surface_seams(mesh):
    """Points next to seams, on them, and next to them on the other side: rows, shape (n, 3), each triple once."""
    found = [np.stack([s.first.line(1), s.first.line(0), s.second.line(1)], axis=1) for s in seams_of_mesh(mesh)]
    triples = np.concatenate([np.zeros((0, 3), dtype=int), *found])
    a, on, b = triples.T
    triples = triples[(a != on) & (on != b) & (a != b)]
    ordered = np.where(triples[:, :1] > triples[:, 2:], triples[:, ::-1], triples)
    return triples[np.sort(np.unique(ordered, axis=0, return_index=True)[1])]


def four_walls():
    """Four unequal blocks above a flat wall whose control points are not evenly spaced."""
    nodes = box(np.linspace(0.0, 2.0, 9) ** 1.3, np.linspace(0.0, 1.0, 10) ** 1.2, np.linspace(0.0, 1.0, 4))
    blocks = split(nodes, [3], [5], [])
    walls = [Window(n, (0, 0, 0), (b.shape[0] - 1, b.shape[1] - 1, 0)) for n, b in enumerate(blocks)]
    return mesh_of(grid_of(*blocks, patches=[patch("wall", *walls)]))


class Given:
    """A user's own constraint: any equations."""

    name = "given"

    def __init__(self, matrix, preferred=None):
        self.matrix = csr_array(matrix)
        n = self.matrix.shape[0]
        self.preferred = np.full(n, -1) if preferred is None else preferred

    def equations(self, mesh, points):
        return Equations(self.matrix, np.zeros(len(self.preferred), dtype=int), self.preferred)


def sparse_normal(random, shape, density):
    return csr_array(np.where(random.random(shape) < density, random.normal(size=shape), 0.0))


def random_equations(seed, n):
    """Equations of few coordinates each, a fifth of them redundant; coefficients are 1 and -1 for even seeds."""
    random = np.random.default_rng(seed)
    matrix = sparse_normal(random, (35, n), 3.0 / n)
    if seed % 2 == 0:
        matrix.data = np.sign(matrix.data)
    mixed = sparse_normal(random, (7, 35), 0.1) @ matrix
    matrix = vstack([matrix, mixed], format="csr")[random.permutation(42)]
    return Given(matrix, random.integers(-1, n, 42))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("make", [channel, oblique_channel])
def test_elimination_is_a_projection_onto_the_null_space_of_all_equations(make, seed):
    mesh = make()
    elimination = eliminate(mesh, surface_of(mesh), [random_equations(seed, 3 * len(mesh.surface_ids))])
    equations = np.concatenate([part.matrix.toarray() for _, part in elimination.constraints])
    matrix, allowed = elimination.matrix.toarray(), null_space(equations)
    np.testing.assert_allclose(equations @ matrix, 0.0, atol=1e-13)
    np.testing.assert_allclose(matrix @ matrix, matrix, atol=1e-13)
    np.testing.assert_allclose(matrix @ allowed, allowed, atol=1e-12)
    assert np.count_nonzero(~elimination.dependent) == allowed.shape[1] == np.linalg.matrix_rank(matrix)
    np.testing.assert_array_equal(elimination.fixed, np.abs(matrix).sum(axis=1) == 0.0)
    np.testing.assert_array_equal(elimination.fixed, np.abs(allowed).max(axis=1) < 1e-12)


def test_independent_coordinates_stay_as_they_are_and_dependent_ones_have_no_effect():
    mesh = channel()
    elimination, d, moved = displaced(mesh, random_equations(1, 3 * len(mesh.surface_ids)))
    is_free = ~elimination.dependent.reshape(-1, 3)
    np.testing.assert_array_equal(moved[is_free], d[is_free])
    assert elimination.matrix[:, elimination.dependent].count_nonzero() == 0


def test_elimination_gives_the_same_bits_again():
    first, again = (displaced(channel(), random_equations(3, 135))[0].matrix for _ in range(2))
    np.testing.assert_array_equal(first.indices, again.indices)
    np.testing.assert_array_equal(first.data, again.data)


def test_preferred_coordinates_follow():
    matrix = np.zeros((2, 135))
    matrix[0, [40, 50, 60]] = 1.0, 0.5, -0.7
    matrix[1, [50, 80]] = 0.001, 1.0  # too small a coefficient to divide by
    elimination = displaced(channel(), Given(matrix, np.array([50, 50])))[0]
    assert list(np.flatnonzero(elimination.sources >= len(channel().in_plane_rows))) == [50, 80]


def test_nearly_parallel_equations_are_one():
    matrix = np.zeros((2, 135))
    matrix[:, 39:42] = OBLIQUE, OBLIQUE + [0.0, 0.0, 1e-8]
    elimination = displaced(channel(), Given(matrix))[0]
    assert elimination.dependent[39:42].sum() == 1
    matrix[1, 41] += 1e-5
    assert displaced(channel(), Given(matrix))[0].dependent[39:42].sum() == 2


@pytest.mark.slow
def test_symmetry_planes_are_kept_exactly():
    mesh = wing()
    elimination, d, moved = displaced(mesh)
    axis = np.argmax(np.abs(mesh.in_plane_normals[0]))
    assert (moved[mesh.in_plane_rows, axis] == 0.0).all()
    assert (
        np.count_nonzero(moved != d)
        == len(mesh.in_plane_rows)
        == elimination.dependent.sum()
        == elimination.fixed.sum()
    )
    assert elimination.reason(3 * mesh.in_plane_rows[0] + axis).startswith("symmetry plane: point (")
    assert elimination.reason(3 * mesh.in_plane_rows[0] + (axis + 1) % 3) == ""


def test_oblique_symmetry_planes_are_kept_to_round_off():
    mesh = oblique_channel()
    elimination, _, moved = displaced(mesh)
    np.testing.assert_allclose((moved[mesh.in_plane_rows] * mesh.in_plane_normals).sum(axis=1), 0.0, atol=1e-15)
    assert elimination.dependent.sum() == len(mesh.in_plane_rows)
    assert not elimination.fixed.any()


@pytest.mark.slow
def test_pinned_points_do_not_move_at_all():
    mesh = wing()
    root = NearPlane(np.zeros(3), mesh.in_plane_normals[0])
    elimination, d, moved = displaced(mesh, Pinned(root), Pinned([21, 25], "x"), Pinned([31], OBLIQUE))
    assert (moved[root.rows(mesh)] == 0.0).all()
    assert (moved[[21, 25], 0] == 0.0).all()
    np.testing.assert_array_equal(moved[[21, 25], 1:], d[[21, 25], 1:])
    assert abs(moved[31] @ OBLIQUE) < 1e-15
    assert elimination.dependent[93:96].sum() == 1


def test_what_depends_on_pinned_points_is_fixed_exactly_whatever_the_ratios():
    mesh, random = channel(), np.random.default_rng(5)
    chain = np.zeros((30, 135))
    for n, row in enumerate(chain):  # each coordinate a weighted mean of its neighbours
        row[40 + n : 43 + n] = random.uniform(0.1, 1.0, 3)
    held = np.zeros((2, 135))
    held[[0, 1], [40, 71]] = 1.0
    elimination, _, moved = displaced(mesh, Given(chain), Given(held))
    assert elimination.fixed[40:72].all()
    assert (moved.ravel()[40:72] == 0.0).all()


def test_quotients_that_are_one_but_for_round_off_are_one():
    mesh, matrix = channel(), np.zeros((1, 135))
    matrix[0, [40, 50]] = 3 * 0.1, -0.3
    _, d, moved = displaced(mesh, Given(matrix, np.array([40])))
    assert matrix[0, 40] != 0.3
    assert moved.ravel()[40] == d.ravel()[50]


@pytest.mark.slow
def test_redundant_equations_change_nothing():
    mesh = wing()
    constraints = [Linked([3, 4, 5], [9, 10, 11]), Opposite([20], [22], "y"), Pinned([30])]
    once = displaced(mesh, *constraints)[0]
    twice = displaced(mesh, *constraints, *constraints, InPlane([30], OBLIQUE), Linked([9], [3]), Linked([7], [7]))[0]
    assert (once.matrix != twice.matrix).nnz == 0


@pytest.mark.slow
def test_linked_points_move_alike_to_the_last_bit():
    mesh = plate()
    lower, upper = (np.searchsorted(mesh.surface_ids, ids) for ids in both_sides(mesh))
    is_inner = lower != upper
    _, d, moved = displaced(mesh, Linked(lower[is_inner], upper[is_inner], "xz"))
    np.testing.assert_array_equal(moved[upper[is_inner]][:, [0, 2]], moved[lower[is_inner]][:, [0, 2]])
    inner_y = upper[is_inner], 1
    np.testing.assert_array_equal(moved[inner_y], d[inner_y])


@pytest.mark.slow
def test_selections_are_paired_by_nearness_but_for_a_shift():
    mesh = plate()
    lower, upper = (np.searchsorted(mesh.surface_ids, ids) for ids in both_sides(mesh))
    is_inner = lower != upper
    lower, upper = lower[is_inner], np.random.default_rng(1).permutation(upper[is_inner])
    for shift in (0.0, [0.3, 0.5, -1.0], [0.0, 0.0, 5.0]):
        points = surface_of(mesh).copy()
        points[upper] += shift
        matrix = eliminate(mesh, points, [Linked(SurfaceRows(lower), upper)]).matrix
        moved = (matrix @ np.random.default_rng(2).normal(size=points.size)).reshape(-1, 3)
        np.testing.assert_array_equal(moved[np.sort(upper)], moved[lower])


@pytest.mark.slow
def test_one_leader_leads_all():
    _, d, moved = displaced(wing(), Linked([21], [25, 29, 31]), EqualDisplacement([3, 5, 9], OBLIQUE))
    np.testing.assert_array_equal(moved[[25, 29, 31]], d[[21, 21, 21]])
    np.testing.assert_allclose(moved[[5, 9]] @ OBLIQUE, moved[3] @ OBLIQUE, atol=1e-14)
    assert np.count_nonzero(moved[[3, 5, 9]] == d[[3, 5, 9]]) == 7


def test_opposite_points_move_oppositely_to_the_last_bit():
    _, d, moved = displaced(wing(), Opposite([18, 21], [31, 34], "y"))
    np.testing.assert_array_equal(moved[[31, 34], 1], -d[[18, 21], 1])
    np.testing.assert_array_equal(moved[[31, 34]][:, [0, 2]], d[[31, 34]][:, [0, 2]])


def test_points_of_a_plane_stay_in_it():
    mesh = oblique_channel()  # its wall is plane, in no coordinate plane
    everywhere = InPlane(np.arange(len(mesh.surface_ids)))
    _, _, moved = displaced(mesh, everywhere)
    normal = nearest_plane(surface_of(mesh))[0]
    assert np.abs(moved @ normal).max() < 1e-14
    assert np.abs(moved).max() > 1.0


def test_mirrored_sides_stay_mirrored():
    mesh = wing()  # its section is symmetric
    surface = surface_of(mesh)
    for mirrored in (Mirrored([0.0, 2.0, 0.0]), Mirrored([0.0, -1.0, 0.0])):
        elimination, _, moved = displaced(mesh, mirrored)
        new, image = surface + moved, (surface + moved) * [1.0, -1.0, 1.0]
        assert np.abs(new[:, None] - image).max(axis=-1).min(axis=1).max() < 1e-5  # as good as the fit is symmetric
        leads = surface[:, 1] * mirrored.normal[1] > 1e-6
        assert (elimination.dependent.reshape(-1, 3)[leads, :2]).sum() == 0


def test_mirrored_in_an_oblique_plane_reflects_displacements():
    mesh, normal = oblique_channel(), OBLIQUE / np.linalg.norm(OBLIQUE)
    surface = surface_of(mesh)
    image = surface[7] - 2.0 * (surface[7] - surface[0]) @ normal * normal
    far = mesh_with(mesh, 19, image)
    _, _, moved = displaced(far, Mirrored(OBLIQUE, surface[0], [0, 7], [0, 19]))
    np.testing.assert_allclose(moved[19], moved[7] - 2.0 * (moved[7] @ normal) * normal, atol=1e-14)
    assert abs(moved[0] @ normal) < 1e-14


def mesh_with(mesh, row, place):
    """The same mesh with one surface point elsewhere."""
    points = mesh.points.copy()
    points[mesh.surface_ids[row]] = place
    return type(mesh)(mesh.blocks, mesh.names, points, mesh.surface_ids, mesh.is_free, mesh.frames)


def test_seams_are_found_once_in_blocks_of_any_kind():
    assert len(surface_seams(channel())) == 5
    mesh = four_walls()
    triples, x = surface_seams(mesh), surface_of(mesh)
    assert len(triples) == 9 + 10
    assert len(np.unique(triples[:, 1])) == 9 + 10 - 1
    along = np.abs(x[triples[:, 2]] - x[triples[:, 0]])
    assert (along[:, 0] == 0.0).sum() == 9
    wall = patch("wall", Window(0, (0, 0, 0), (16, 0, 3)))
    mesh = mesh_of(grid_of(o_grid(), patches=[wall]))
    triples, x = surface_seams(mesh), surface_of(mesh)
    assert len(triples) == 4  # where the block meets itself
    np.testing.assert_allclose(x[triples[:, 1]][:, :2], np.tile(x[triples[0, 1], :2], (4, 1)), atol=1e-14)


@pytest.mark.parametrize("seed", range(4))
def test_seams_of_turned_blocks_join_the_same_places(seed):
    mesh, random = four_walls(), np.random.default_rng(seed)
    blocks = tuple(ORIENTATIONS[random.integers(48)].apply(ids) for ids in mesh.blocks)
    turned = replace(mesh, blocks=tuple(blocks[n] for n in random.permutation(4)))
    found, expected = (
        {frozenset([(a, on), (b, on)]) for a, on, b in surface_seams(m).tolist()} for m in (turned, mesh)
    )
    assert found == expected


def test_sides_between_blocks_and_collapsed_sides_have_no_seams():
    mesh = mesh_of(channel_grid(), design="*")
    thin = replace(mesh, blocks=tuple(ids[:, :, [0, -1]] for ids in mesh.blocks))  # both sides of both are surface
    triples, between = surface_seams(thin), np.searchsorted(mesh.surface_ids, thin.blocks[0][-1])
    crosses = np.isin(triples, between) @ [1, 2, 4] == 2
    np.testing.assert_array_equal(np.unique(triples[crosses, 1]), np.sort(between, axis=None))
    walls = four_walls()
    line = walls.blocks[0][-1, :, 0]  # the seam between the first two walls, and a wake behind it
    wake = np.stack([np.stack([line, line, line], axis=1), np.arange(3 * len(line)).reshape(-1, 3)], axis=2)
    np.testing.assert_array_equal(
        surface_seams(replace(walls, blocks=(*walls.blocks, wake.astype(np.int32)))), surface_seams(walls)
    )


def test_control_points_across_smooth_seams_stay_in_line_also_where_four_sides_meet():
    mesh = four_walls()
    surface, triples = surface_of(mesh), surface_seams(mesh)
    elimination, d, moved = displaced(mesh, TangentContinuity())
    before, after = np.diff((surface + 0.1 * moved)[triples], axis=1).transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(before, after), axis=1).max() < 1e-15
    is_on_seam = np.zeros(len(surface), dtype=bool)
    is_on_seam[triples[:, 1]] = True
    np.testing.assert_array_equal(moved[~is_on_seam], d[~is_on_seam])
    assert elimination.dependent.sum() == 3 * (len(triples) - 1)  # where two seams cross, one follows from the other


def test_affine_moves_pass_tangent_continuity_and_translations_pass_linked():
    mesh = four_walls()
    surface = surface_of(mesh)
    affine = surface @ np.random.default_rng(1).normal(size=(3, 3))
    elimination = eliminate(mesh, surface, [TangentContinuity()])
    np.testing.assert_allclose(elimination.matrix @ affine.ravel(), affine.ravel(), atol=1e-14)
    shift = np.tile([0.3, -0.2, 0.1], len(surface))
    elimination = eliminate(mesh, surface, [EqualDisplacement(np.arange(len(surface))), Linked([3], [7])])
    np.testing.assert_array_equal(elimination.matrix @ shift, shift)


def test_pinned_seams_hand_their_neighbours_over():
    mesh = four_walls()
    triples = surface_seams(mesh)
    _, _, moved = displaced(mesh, TangentContinuity(), Pinned(triples[:, 1]))
    assert (moved[triples[:, 1]] == 0.0).all()
    before, after = np.diff((surface_of(mesh) + 0.1 * moved)[triples], axis=1).transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(before, after), axis=1).max() < 1e-15
    assert np.abs(moved[triples[:, [0, 2]]]).max() > 0.1


@pytest.mark.parametrize(
    ("constraint", "message"),
    [
        (
            TangentContinuity(InBox(), name="seams"),
            r"'seams': the surface has a kink of 1\d\d deg at point \(\d+, .* of block",
        ),
        (TangentContinuity(mirror=False), "no point is on a seam"),
        (TangentContinuity([16], mirror=False), "no point is on a seam"),
        (Mirrored([0, 0, 1.0]), r"point \(\d, \d, \d\) of block \d has no partner, the nearest point is .* m off"),
        (Mirrored([0, 1.0, 0], tolerance=0.5), "partners"),
        (InPlane(np.arange(36), name="root"), r"'root': point \(.*\) of block \d is .* m off the plane through all"),
        (Pinned(InBox(low=(99.0, None, None))), "none of the 36 surface control points"),
        (Pinned([36], name="root"), "'root': there is no surface control point 36; give numbers from 0 to 35"),
        (Pinned([]), "give a selection"),
        (Pinned([0.5]), "give a selection"),
        (Pinned([1], "w"), "no direction is called 'w'"),
        (Pinned([1], [0.0, 0.0, 0.0]), "give directions"),
        (Pinned([1], [1.0, 0.0]), "give directions"),
        (Linked([1, 2], [3, 4, 5], name="edge"), "'edge': 2 points cannot be paired with 3"),
        (Opposite(SurfaceRows([]), [3]), "none of the 36"),
        (Given(np.zeros((1, 7))), r"'given': equations of shape \(1, 7\)"),
        (Given(np.zeros((1, 108)), np.array([108])), "'given': there is no coordinate 108; give 0 to 107"),
        (Given(np.full((1, 108), np.nan)), "'given': a coefficient is not finite"),
    ],
)
def test_what_cannot_be_satisfied_is_named(constraint, message):
    with pytest.raises(InputError, match=message):
        displaced(wing(), constraint)


@pytest.mark.slow
def test_coinciding_sides_are_mirrored_where_leaders_and_followers_are_named():
    mesh = plate()
    sides = [np.searchsorted(mesh.surface_ids, ids) for ids in both_sides(mesh)]
    sides = [rows[sides[0] != sides[1]] for rows in sides]
    with pytest.raises(InputError, match="has 2 partners"):
        displaced(mesh, Mirrored([0.0, 1.0, 0.0]))
    _, _, moved = displaced(mesh, Mirrored([0.0, 1.0, 0.0], (0.0, 0.0, 0.0), *sides))
    np.testing.assert_array_equal(moved[sides[1]], moved[sides[0]] * [1.0, -1.0, 1.0])
    assert np.abs(moved[sides[0]]).max() > 1.0


def test_reasons_name_constraint_and_place():
    elimination = displaced(wing(), Pinned([30], name="root"), Linked([3], [7], "x", name="edge"))[0]
    assert elimination.reason(90).startswith("root: point (")
    assert elimination.reason(21).startswith("edge: point (")
    assert elimination.fixed[90]
    assert not elimination.fixed[21]


@pytest.mark.slow
def test_long_chains_of_thousands_of_points_are_eliminated_to_round_off():
    mesh = mesh_of(onera_m6_grid((49, 5, 35)))
    n = len(mesh.surface_ids)
    assert n > 3000
    random = np.random.default_rng(0).permutation(n)
    constraints = [
        Mirrored([0.0, 1.0, 0.0]),
        EqualDisplacement(np.arange(n), "z"),
        Linked(random[:-1], random[1:], "x"),
    ]
    elimination = displaced(mesh, *constraints)[0]
    assert elimination.dependent.sum() > 6000
    for _, equations in elimination.constraints:
        assert abs(equations.matrix @ elimination.matrix).max() < 1e-12
