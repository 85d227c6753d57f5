"""Moves and products that go together are those that go alone, with one pass over each factor for all of them."""

import numpy as np
import pytest
from mover_cases import bent_surface, channel, random_changes, wing

from bspline_mdao.base.sparse.cholesky import CholeskyFactor
from bspline_mdao.base.sparse.scalar import ScalarFactor
from bspline_mdao.core.movement.moved_together import jvps_together, moved_together, vjps_together
from bspline_mdao.core.movement.rotations import Rotations
from bspline_mdao.errors import MovementError
from bspline_mdao.movers import LinearElasticity
from bspline_mdao.testing import dot_test


def surfaces_of(mesh, n=5):
    return [bent_surface(mesh, size=0.05 + 0.1 * seed, seed=seed)[1] for seed in range(n)]


def passes(monkeypatch):
    """List that grows by one with every pass over a factor."""
    seen = []
    for kind in (CholeskyFactor, ScalarFactor):
        solve = kind.solve
        monkeypatch.setattr(kind, "solve", lambda self, right, of=solve: seen.append(right.shape) or of(self, right))
    return seen


def moved(mesh, n=5):
    mover = Rotations(mesh)
    start = mover.start(mesh.points)
    return mover, [mover.move(mesh.points, surface, start=start) for surface in surfaces_of(mesh, n)]


def assert_close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_moves_that_go_together_are_those_that_go_alone_with_as_many_passes_as_one(monkeypatch):
    mesh = wing()
    mover, alone = moved(mesh)
    start, seen = mover.start(mesh.points), passes(monkeypatch)
    mover.move(mesh.points, surfaces_of(mesh)[0], start=start)
    n_of_one = len(seen)
    seen.clear()
    together = moved_together(mover, mesh.points, surfaces_of(mesh), start)
    assert len(seen) == n_of_one == 3
    assert all(shape[-1] == 5 for shape in seen)
    for one, other in zip(together, alone, strict=True):
        assert_close(one.points, other.points)
        assert one.start is start
        assert one.report.increments[-1].corner_ratio == pytest.approx(other.report.increments[-1].corner_ratio)


def test_a_move_that_cannot_be_made_leaves_the_others_as_they_are():
    mesh = wing()
    mover, alone = moved(mesh, 3)
    surfaces = surfaces_of(mesh, 3)
    surfaces.insert(1, np.full_like(surfaces[0], np.nan))
    first, wrong, *others = moved_together(mover, mesh.points, surfaces)
    assert isinstance(wrong, MovementError)
    assert "is not finite" in str(wrong)
    for one, other in zip([first, *others], alone, strict=True):
        assert_close(one.points, other.points)


def test_products_that_go_together_are_those_that_go_alone_and_transposes_of_each_other(monkeypatch):
    mesh = channel()
    _, movements = moved(mesh, 3)
    movements.append(movements[1])  # one of them in two directions
    changes = [random_changes(mesh, seed) for seed in range(4)]
    bars = list(np.random.default_rng(7).normal(size=(4, *mesh.points.shape)))
    seen = passes(monkeypatch)
    forward = jvps_together(movements, *zip(*changes))
    backward = vjps_together(movements, bars)
    n_passes = len(seen)
    for movement, change, bar, of_change, of_bar in zip(movements, changes, bars, forward, backward, strict=True):
        assert_close(of_change, movement.jvp(*change))
        for mine, other in zip(of_bar, movement.vjp(bar), strict=True):
            assert_close(mine, other)
    assert n_passes < 0.5 * (len(seen) - n_passes)


def test_transposes_that_go_together_pass_the_dot_test():
    mesh = channel()
    _, movements = moved(mesh, 2)
    n_surface, still = len(mesh.surface_ids), [np.zeros_like(mesh.points)] * 2

    def forward(v):
        return np.ravel(jvps_together(movements, still, list(v.reshape(2, n_surface, 3))))

    def transposed(w):
        return np.ravel([bars[1] for bars in vjps_together(movements, list(w.reshape(2, mesh.n_points, 3)))])

    assert dot_test(forward, transposed, 6 * n_surface, 6 * mesh.n_points) < 1e-11


def test_movers_without_a_task_move_one_after_the_other():
    mesh = channel()
    mover, surfaces = LinearElasticity(mesh, n_increments=2), surfaces_of(mesh, 2)
    together = moved_together(mover, mesh.points, [*surfaces, np.full_like(surfaces[0], np.inf)])
    assert isinstance(together.pop(), MovementError)
    for one, surface in zip(together, surfaces, strict=True):
        np.testing.assert_array_equal(one.points, mover.move(mesh.points, surface).points)
    (bars,) = vjps_together(together[:1], [np.cos(mesh.points)])
    np.testing.assert_array_equal(bars[1], together[0].vjp(np.cos(mesh.points))[1])
