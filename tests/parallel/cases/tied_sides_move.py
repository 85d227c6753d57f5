"""Moves of a passage by several processes that share the rows of tied points: those of one, and their products."""

import numpy as np
from mover_cases import mesh_of
from parallel_checks import assert_same_everywhere
from periodic_cases import cut_passage

from bspline_mdao.base.numerics.processes import world
from bspline_mdao.core.movement.shared import shared_mover
from bspline_mdao.movers import LinearElasticity, PetscMultigrid, Rotations, TorsionalSprings

comm = world()
for motion in ("translation", "rotation"):
    mesh = mesh_of(cut_passage(motion, seed=2))
    rng = np.random.default_rng(0)
    at_rest = mesh.points[mesh.surface_ids]
    surface = at_rest + 0.004 * np.sin(at_rest @ rng.uniform(-2.0, 2.0, (3, 3)))
    d_initial, d_surface, bar = (rng.normal(size=x.shape) for x in (mesh.points, surface, mesh.points))
    for kind in (LinearElasticity, TorsionalSprings):
        mover = kind(mesh, n_increments=2)
        expected = mover.move(mesh.points, surface)
        found = shared_mover(mover, comm, "all").move(mesh.points, surface)
        assert f"by MUMPS on {comm.size} processes" in str(found.report)
        assert_same_everywhere(comm, found.points)
        ties, change = mesh.ties, found.points - mesh.points
        turned = np.einsum("nij,nj->ni", ties.turns, change[ties.originals])
        np.testing.assert_allclose(turned, change[ties.copies], rtol=0.0, atol=1e-15 * mesh.size)
        np.testing.assert_allclose(found.points, expected.points, rtol=0.0, atol=1e-13 * mesh.size)
        forward, back = found.jvp(d_initial, d_surface), found.vjp(bar)
        there = np.vdot(back[0], d_initial) + np.vdot(back[1], d_surface)
        assert abs(np.vdot(bar, forward) - there) < 1e-11 * np.linalg.norm(bar) * np.linalg.norm(forward)
        wanted = expected.jvp(d_initial, d_surface)
        assert abs(forward - wanted).max() < 1e-11 * abs(wanted).max()
    own = shared_mover(LinearElasticity(mesh, n_increments=2, solver=PetscMultigrid()), comm)
    expected = LinearElasticity(mesh, n_increments=2).move(mesh.points, surface)
    assert abs(own.move(mesh.points, surface).points - expected.points).max() < 3e-10 * mesh.size
    first = shared_mover(Rotations(mesh), comm).move(mesh.points, surface)
    np.testing.assert_array_equal(first.points, Rotations(mesh).move(mesh.points, surface).points)
print(f"done {comm.rank}")
