"""Tensor surfaces of sides: exact where knots are straight, within the tolerance where they are curved."""

import numpy as np
import pytest

from bspline_mdao import InputError
from bspline_mdao.base.numerics.vectors import lengths
from bspline_mdao.core.cad.tensor_surface import tensor_surface
from bspline_mdao.core.splines.side import VolumeSide
from bspline_mdao.core.splines.volume import Volume
from bspline_mdao.splines import BilinearKnots, ConstantKnots, FunctionKnots


def curved(rng, n: int, order: int) -> BilinearKnots:
    """Knots that differ on all four edges."""
    inner = (np.arange(1, n - order + 1) + rng.uniform(-0.3, 0.3, (2, 2, n - order))) / (n - order + 1)
    return BilinearKnots(np.concatenate([np.zeros((2, 2, order)), inner, np.ones((2, 2, order))], axis=-1), order)


def bent_net(rng, *shape: int) -> np.ndarray:
    """Control points of a smooth surface that is bent at random, some 1 m large."""
    i, j, k = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in shape), indexing="ij")
    a, b = rng.uniform(0.5, 1.0, (2, 3))
    net = np.stack([i + 0.1 * np.sin(2 * j), j + 0.1 * k * i, k + 0.2 * np.sin(a[0] + 3 * a[1] * i + 2 * b[2] * j)], -1)
    return net + rng.uniform(-0.01, 0.01, net.shape)


def random_lattice(rng):
    return np.sort(rng.random(23)), np.sort(rng.random(19))


def difference(side: VolumeSide, surface, u, v) -> float:
    grid = [x.ravel() for x in np.meshgrid(u, v, indexing="ij")]
    return lengths(surface.lattice(u, v).reshape(-1, 3) - side.points(*grid)).max()


@pytest.mark.parametrize("axes", [(1, 2), (2, 1)])
def test_a_side_with_straight_knots_is_taken_as_it_is(axes):
    rng = np.random.default_rng(1)
    bilinear = BilinearKnots(np.tile(ConstantKnots.uniform(6, 4).knots, (2, 2, 1)), 4)
    volume = Volume((curved(rng, 5, 4), bilinear, ConstantKnots.uniform(5, 3)))
    side = VolumeSide(volume, rng.random((5, 6, 5, 3)), 0, 1, axes)
    surface = tensor_surface(side, 1e-3, "side")
    assert surface.is_exact
    assert surface.control_points.shape[:2] == ((6, 5) if axes == (1, 2) else (5, 6))
    assert difference(side, surface, *random_lattice(rng)) < 1e-14
    assert surface.error < 1e-14
    assert surface.angle < 1e-10


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_a_side_with_curved_knots_is_met_within_the_tolerance_and_its_edges_exactly(tolerance):
    rng = np.random.default_rng(2)
    volume = Volume((curved(rng, 7, 4), curved(rng, 6, 4), curved(rng, 5, 4)))
    side = VolumeSide(volume, bent_net(rng, 7, 6, 5), 2, 0, (0, 1))
    surface = tensor_surface(side, tolerance, "side")
    assert not surface.is_exact
    u, v = random_lattice(rng)
    inside = difference(side, surface, u, v)
    assert tolerance / 1000 < inside <= tolerance
    assert abs(surface.error / inside - 1.0) < 2.0
    for end in (np.zeros(1), np.ones(1)):
        assert difference(side, surface, u, end) < 1e-14
        assert difference(side, surface, end, v) < 1e-14


def test_knots_of_a_users_function_are_refitted_too():
    rng = np.random.default_rng(3)
    sine = FunctionKnots(
        order=4,
        n_control=5,
        value=lambda s, t: 0.5 + 0.1 * np.sin(3.0 * s[:, None]),
        gradient=lambda s, t: np.stack([0.3 * np.cos(3.0 * s), 0 * t], axis=-1)[:, None],
    )
    side = VolumeSide(
        Volume((sine, ConstantKnots.uniform(5, 4), ConstantKnots.uniform(4, 4))), bent_net(rng, 5, 5, 4), 2, 1, (0, 1)
    )
    surface = tensor_surface(side, 1e-5, "side")
    assert difference(side, surface, *random_lattice(rng)) <= 1e-5


def test_a_tolerance_that_is_out_of_reach_is_refused_in_one_line_that_tells_how_far_it_got():
    rng = np.random.default_rng(4)
    volume = Volume((curved(rng, 7, 3), curved(rng, 6, 3), curved(rng, 5, 3)))
    side = VolumeSide(volume, bent_net(rng, 7, 6, 5), 2, 0, (0, 1))
    with pytest.raises(InputError, match=r"^wall: .* m off with \d+ x \d+ control points, .* 1e-14 m; raise it$"):
        tensor_surface(side, 1e-14, "wall", most=60)
