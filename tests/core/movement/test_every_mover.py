"""What every mover must do, for all of them: whoever adds one adds a line to `MOVERS`."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from pkgutil import resolve_name

import numpy as np
import pytest
from elastic_cases import crooked_box
from mover_cases import (
    MOVERS,
    assert_derivative_is_exact,
    assert_derivative_is_transposed,
    assert_known_points_match,
    bent_surface,
    changes_in_planes,
    channel,
    in_symmetry,
    irregular,
    made,
    oblique_channel,
    plate,
    random_changes,
    rotation,
    wing,
)
from test_suite import kinds

import bspline_mdao
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.movers import ComovingFrame
from bspline_mdao.studio.cli import movers


def those(**wanted):
    """Parametrise over the movers whose cases have certain attributes; over all without any."""
    cases = MOVERS.items()
    found = [kind for kind, case in cases if all(getattr(case, name) == value for name, value in wanted.items())]
    return pytest.mark.parametrize("kind", found, ids=lambda kind: kind.__name__)


EVERY = those()

FRAMES = {ComovingFrame}
"""What takes another mover along, see ``test_comoving.py``."""


def open_channel(is_oblique):
    return channel(is_oblique, released=("farfield",))


def design(kind, mesh):
    """Initial points and a bent surface at which a mover is differentiable, and changes along which it stays so."""
    case = MOVERS[kind]
    initial, surface = bent_surface(mesh, size=case.slope_bend)
    if not case.is_graph:
        return initial, surface, random_changes
    initial = irregular(mesh)
    return initial, surface + (initial - mesh.points)[mesh.surface_ids], changes_in_planes


def test_every_mover_is_in_the_table():
    assert kinds("core.movement", "mesh", "move") - FRAMES == set(MOVERS)


@pytest.mark.parametrize(
    ("words", "folder", "members"),
    [
        (movers.MOVERS, "core.movement", ("mesh", "move")),
        (movers.STIFFNESS, "core.movement", ("modulus", "modulus_vjp")),
        (movers.SOLVERS, "base.sparse", ("name", "analyze")),
    ],
)
def test_every_mover_law_and_solver_has_a_word_on_the_command_line_and_a_public_name(words, folder, members):
    found = kinds(folder, *members) - FRAMES
    assert {resolve_name(place) for place in words.values()} == found
    assert all(getattr(bspline_mdao.movers, kind.__name__) is kind for kind in found)


@pytest.mark.slow
@EVERY
@pytest.mark.parametrize("make", [channel, oblique_channel, plate, wing])
def test_known_points_match_and_others_slide(make, kind):
    mesh = make()
    initial, surface = bent_surface(mesh, size=MOVERS[kind].bend)
    movement = made(kind, mesh, 3).move(initial, surface)
    assert_known_points_match(mesh, initial, surface, movement.points)
    follows = np.abs(movement.points - initial)[mesh.is_free.any(axis=1)].max()
    assert follows > 0.003 * np.ptp(surface) or kind.__name__ == "FixedInterior"
    assert all(increment.solve.residual < 1e-10 for increment in movement.report.increments if increment.solve)


@those(is_graph=False)  # whose free sides would be outside of the graph
def test_known_points_match_where_edges_are_collapsed(kind):
    mesh = crooked_box(amount=0.1, is_collapsed=True)
    initial, surface = bent_surface(mesh, size=MOVERS[kind].bend)
    assert_known_points_match(mesh, initial, surface, made(kind, mesh, 3).move(initial, surface).points)


@EVERY
@pytest.mark.parametrize("make", [channel, oblique_channel, plate, wing])
def test_a_surface_at_rest_moves_nothing(make, kind):
    mesh = make()
    movement = made(kind, mesh, 2).move(mesh.points, mesh.points[mesh.surface_ids])
    np.testing.assert_array_equal(movement.points, mesh.points)


@those(translates=True)
@pytest.mark.parametrize("is_oblique", [False, True])
def test_everything_follows_a_translation_where_the_far_field_may(is_oblique, kind):
    mesh = open_channel(is_oblique)
    shift = in_symmetry(mesh, np.ones((len(mesh.surface_ids), 3)))[mesh.in_plane_rows[0]]
    points = made(kind, mesh, 3).move(mesh.points, mesh.points[mesh.surface_ids] + shift).points
    np.testing.assert_allclose(points, mesh.points + shift, atol=1e-13)


@those(turns=True)
def test_the_move_turns_with_the_mesh(kind):
    straight, turned, turn = channel(), oblique_channel(), rotation()
    np.testing.assert_allclose(turned.points, straight.points @ turn.T, atol=1e-14)
    initial, surface = bent_surface(straight, size=MOVERS[kind].bend)
    points = made(kind, straight, 2).move(initial, surface).points
    again = made(kind, turned, 2).move(initial @ turn.T, surface @ turn.T).points
    np.testing.assert_allclose(again, points @ turn.T, atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "n_increments"),
    [(kind, m) for kind, case in MOVERS.items() for m in (1, 2, 5) if case.has_increments or m == 1],
)
@pytest.mark.parametrize("is_oblique", [False, True])
def test_derivatives_are_exact_and_transposed(is_oblique, n_increments, kind):
    mesh = channel(is_oblique) if MOVERS[kind].is_graph else open_channel(is_oblique)
    mover = made(kind, mesh, n_increments)
    initial, surface, changes = design(kind, mesh)
    assert_derivative_is_transposed(mover.move(initial, surface))
    assert_derivative_is_exact(mover, initial, surface, changes=changes)


@those(has_increments=True)
@pytest.mark.parametrize("n_increments", [0, -1, 1.5, True, "auto", None])
def test_what_is_no_number_of_increments_is_refused_when_the_mover_is_made(kind, n_increments):
    with pytest.raises(InputError, match=r"increments; give a whole number from 1"):
        kind(channel(), n_increments=n_increments)


@those(has_increments=True)
def test_movers_that_solve_for_equilibrium_make_the_increments_of_the_paper_and_others_one(kind):
    mesh = channel()
    assert kind(mesh).n_increments == MOVERS[kind].default
    assert kind(mesh).move(*bent_surface(mesh, size=1e-3)).report.n_increments == MOVERS[kind].default
    assert len(kind(mesh, n_increments=4).move(*bent_surface(mesh, size=0.01)).report.increments) == 4


@EVERY
def test_bad_inputs_are_refused(kind):
    mesh = channel()
    mover, initial, surface = kind(mesh), mesh.points.copy(), mesh.points[mesh.surface_ids]
    with pytest.raises(InputError, match=r"movement: points of shape \(.*\); give shape"):
        mover.move(initial[1:], surface)
    with pytest.raises(InputError, match=r"movement: surface points of shape \(.*\); give shape"):
        mover.move(initial, surface[1:])
    with pytest.raises(MovementError, match="leaves its symmetry plane by"):
        mover.move(initial, surface + 0.1 * mesh.in_plane_normals[0])
    initial[4] = np.nan
    with pytest.raises(MovementError, match="movement: point 5 is not finite"):
        mover.move(initial, surface)


@EVERY
def test_a_move_does_not_see_its_arguments_change_afterwards(kind):
    mover = made(kind, channel(), 2)
    initial, surface = bent_surface(mover.mesh, size=0.03)
    movement = mover.move(initial, surface)
    points, bars = movement.points.copy(), movement.vjp(np.ones_like(initial))
    initial += 1.0
    surface += 1.0
    np.testing.assert_array_equal(movement.points, points)
    for before, after in zip(bars, movement.vjp(np.ones_like(initial))):
        np.testing.assert_array_equal(after, before)


@EVERY
def test_a_movement_is_pickled_with_its_derivative(kind):
    mesh = wing()
    initial, surface = bent_surface(mesh, size=0.03)
    movement = made(kind, mesh, 2).move(initial, surface)
    again = pickle.loads(pickle.dumps(movement))
    for mine, other in zip(again.vjp(np.cos(initial)), movement.vjp(np.cos(initial))):
        np.testing.assert_array_equal(mine, other)


@pytest.mark.slow
@EVERY
def test_threads_that_share_a_mover_get_the_same_bits(kind):
    mesh = oblique_channel()
    mover, fresh = made(kind, mesh, 2), made(kind, mesh, 2)

    def used(mover, seed):
        movement = mover.move(*bent_surface(mesh, size=0.02, seed=seed))
        return [movement.points, movement.jvp(*random_changes(mesh)), *movement.vjp(np.cos(movement.points))]

    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda seed: used(mover, seed), range(4)))
    for seed, mine in enumerate(found):
        for one, other in zip(mine, used(fresh, seed), strict=True):
            np.testing.assert_array_equal(one, other)
