"""Distance between patches, from points and from planes."""

from dataclasses import replace

import numpy as np
import pytest
from geometry_cases import assert_derivatives_are_exact, box_sheets, roughened, sphere, surface_of
from scipy.spatial.distance import cdist

from bspline_mdao.errors import InputError
from bspline_mdao.measures import Clearance, PlaneClearance


def two_bodies(gap=0.7, counts=(4, 5, 6)):
    """Unit sphere, and a box of 1 m x 2 m x 3 m at a distance from it along x."""
    ball, sheets = sphere(6, 1.0), box_sheets(counts, low=(1.0 + gap, -1.0, -1.5), high=(2.0 + gap, 1.0, 1.5))
    both = surface_of(*(ball.points[ids] for ids in ball.faces), *sheets)
    return replace(both, patches=("ball",) * 6 + ("box",) * 6)


def nodes(surface, patch):
    return np.unique(np.concatenate([surface.faces[number].ravel() for number in surface.part(patch)]))


def smallest(surface, points):
    return cdist(points[nodes(surface, "ball")], points[nodes(surface, "box")]).min()


@pytest.mark.parametrize("rho", [5.0, 200.0])
def test_the_bound_is_below_the_smallest_distance_by_no_more_than_it_says(rho):
    surface = two_bodies()
    measure = Clearance.between(surface, "ball", "box", rho=rho)
    for seed in range(3):
        points = roughened(surface, 0.02, seed)
        slack = smallest(surface, points) - measure.evaluate(points).item()
        n_pairs = len(measure.ids) * len(measure.other_ids)
        assert 0.0 <= slack <= np.log(n_pairs) / measure.rule.rho


def test_the_bound_tends_to_the_smallest_distance():
    surface = two_bodies()
    found = [Clearance.between(surface, "ball", "box", rho=rho).evaluate(surface.points).item() for rho in (50.0, 5e4)]
    exact = smallest(surface, surface.points)
    assert exact - found[1] < 1e-4 * exact < exact - found[0]


def test_it_is_the_bound_of_all_pairs():
    surface = two_bodies(counts=(3, 3, 4))
    measure = Clearance.between(surface, "ball", "box", rho=8.0)
    distances = cdist(surface.points[measure.ids], surface.points[measure.other_ids])
    exact = -np.log(np.exp(-measure.rule.rho * distances).sum()) / measure.rule.rho
    assert measure.evaluate(surface.points).item() == pytest.approx(exact, rel=1e-13)


def test_it_follows_the_nearest_pair_wherever_the_bodies_move():
    surface = two_bodies()
    measure = Clearance.between(surface, "ball", "box", rho=1e5)
    for shift in ([0.0, 3.0, 0.0], [3.0, 0.0, 4.0], [-0.3, 0.2, 0.0]):
        points = surface.points.copy()
        points[nodes(surface, "box")] += shift
        assert measure.evaluate(points).item() == pytest.approx(smallest(surface, points), rel=1e-3)


def test_surfaces_are_nearer_than_their_nodes_by_less_than_the_reach():
    surface = two_bodies(gap=0.4)
    measure = Clearance.between(surface, "ball", "box", rho=1e6)
    excess = measure.evaluate(surface.points).item() - 0.4
    assert 0.01 < excess < measure.reach


def test_clearance_from_points_is_that_from_a_patch_of_the_same_points():
    surface = two_bodies()
    fixed = surface.points[nodes(surface, "box")]
    pair = Clearance.between(surface, "ball", "box"), Clearance.from_points(surface, "ball", fixed)
    np.testing.assert_allclose(*(measure.evaluate(surface.points) for measure in pair), rtol=1e-14)
    assert pair[1].partials(surface.points).nnz == 3 * len(nodes(surface, "ball"))


def test_clearance_from_a_plane_is_signed():
    surface = two_bodies()
    measure = PlaneClearance.of(surface, "ball", origin=[-1.5, 7.0, 3.0], normal=[2.0, 0.0, 0.0], rho=1e5)
    lowest = surface.points[nodes(surface, "ball"), 0].min()
    assert measure.evaluate(surface.points).item() == pytest.approx(lowest + 1.5, abs=1e-3)
    assert measure.evaluate(surface.points - [1.0, 0.0, 0.0]).item() == pytest.approx(lowest + 0.5, abs=1e-3)
    assert measure.evaluate(surface.points - [2.0, 0.0, 0.0]).item() == pytest.approx(lowest - 0.5, abs=1e-3)
    assert measure.evaluate(surface.points).item() <= lowest + 1.5


def measures():
    surface = two_bodies(counts=(3, 4, 3))
    return {
        "patches": Clearance.between(surface, "ball", "box", rho=10.0),
        "points": Clearance.from_points(surface, ["box", "ball"], [[0.1, 0.2, 0.3], [5.0, 1.0, 2.0]], rho=10.0),
        "plane": PlaneClearance.of(surface, "ball", [-2.0, 0.0, 0.0], [1.0, 0.3, -0.2], rho=20.0),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", ["patches", "points", "plane"])
def test_derivatives_are_exact(name):
    assert_derivatives_are_exact(measures()[name])


def test_moving_everything_does_not_change_the_clearance_of_patches():
    measure = measures()["patches"]
    jacobian = measure.partials(roughened(measure.surface))
    np.testing.assert_allclose(jacobian.toarray().reshape(-1, 3).sum(axis=0), 0.0, atol=1e-13)


def test_sides_that_touch_are_refused():
    surface = two_bodies()
    with pytest.raises(InputError, match="the two sides touch on the baseline"):
        Clearance.between(surface, "ball", ["box", "ball"])
    with pytest.raises(InputError, match="the two sides touch"):
        Clearance.from_points(surface, "ball", surface.points[:1])


def test_what_cannot_be_used_is_refused():
    surface = two_bodies()
    with pytest.raises(InputError, match="no patch is called 'tail'"):
        Clearance.between(surface, "ball", "tail")
    with pytest.raises(InputError, match=r"points of shape \(1, 2\)"):
        Clearance.from_points(surface, "ball", [1.0, 2.0])
    with pytest.raises(InputError, match="rho is 0"):
        Clearance.between(surface, "ball", "box", rho=0.0)
    with pytest.raises(InputError, match="the normal of the plane is"):
        PlaneClearance.of(surface, "ball", [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
