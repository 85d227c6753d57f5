"""Links between a surface and a beam: rigid motions, work, force and moment, exact derivatives."""

import numpy as np
import pytest

from bspline_mdao import InputError
from bspline_mdao.flow.loads.rigid_links import RigidLinks

RNG = np.random.default_rng(0)
BEAM = np.cumsum(RNG.uniform(0.1, 0.5, (5, 3)), axis=0)
POINTS = RNG.uniform(0.0, 2.0, (17, 3))
LINKS = RigidLinks.to_beam(POINTS, BEAM)
X, NODES = POINTS + 0.1 * RNG.standard_normal(POINTS.shape), BEAM + 0.1 * RNG.standard_normal(BEAM.shape)
U, FORCES = RNG.standard_normal((5, 6)), RNG.standard_normal((17, 3))


def test_a_rigid_motion_of_the_beam_is_one_of_the_surface():
    shift, turn = RNG.standard_normal((2, 3))
    u = np.hstack([shift + np.cross(turn, NODES), np.tile(turn, (5, 1))])
    np.testing.assert_allclose(LINKS.displacements(X, NODES, u), shift + np.cross(turn, X), atol=1e-14)


def test_loads_do_the_work_of_the_forces():
    work = np.sum(FORCES * LINKS.displacements(X, NODES, U))
    assert np.sum(LINKS.loads(X, NODES, FORCES) * U) == pytest.approx(work, rel=1e-13)


def test_loads_have_the_force_and_the_moment_of_the_forces():
    loads = LINKS.loads(X, NODES, FORCES)
    np.testing.assert_allclose(loads[:, :3].sum(axis=0), FORCES.sum(axis=0), atol=1e-13)
    moment = loads[:, 3:].sum(axis=0) + np.cross(NODES, loads[:, :3]).sum(axis=0)
    np.testing.assert_allclose(moment, np.cross(X, FORCES).sum(axis=0), atol=1e-13)


def test_points_hang_on_the_ends_of_the_nearest_element():
    beam = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])
    weights = RigidLinks.to_beam(np.array([[0.25, 0.1, 3.0], [1.3, 1.5, 0.0], [-2.0, 0.0, 0.0]]), beam).weights
    np.testing.assert_allclose(weights.toarray(), [[0.75, 0.25, 0.0], [0.0, 0.25, 0.75], [1.0, 0.0, 0.0]], atol=1e-15)


@pytest.mark.parametrize(("name", "third"), [("displacements", U), ("loads", FORCES)])
def test_products_are_exact_and_transposes(name, third):
    evaluate, jvp, vjp = (getattr(LINKS, name + end) for end in ("", "_jvp", "_vjp"))
    at = X, NODES, third
    along = [RNG.standard_normal(a.shape) for a in at]
    exact = np.imag(evaluate(*(a + 1e-30j * d for a, d in zip(at, along)))) / 1e-30
    change = jvp(*at, *along)
    np.testing.assert_allclose(change, exact, atol=1e-13)
    bar = RNG.standard_normal(change.shape)
    for k, back in enumerate(vjp(*at, bar)):
        only = [d * (j == k) for j, d in enumerate(along)]
        assert np.sum(back * along[k]) == pytest.approx(np.sum(jvp(*at, *only) * bar), rel=1e-12)


@pytest.mark.parametrize("beam", [BEAM[:1], BEAM[[0, 1, 1]]])
def test_beams_without_length_are_refused(beam):
    with pytest.raises(InputError, match="links: give the beam two nodes at least"):
        RigidLinks.to_beam(POINTS, beam)
