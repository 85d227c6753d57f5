"""Certified validity of splines, curved knots included: what is called valid is, wherever it is looked at."""

import numpy as np
import pytest

from bspline_mdao import InputError, certify, fit_grid
from bspline_mdao.core.evaluation.derivative_cones import are_positive
from bspline_mdao.core.evaluation.spline_validity import spline_statuses
from bspline_mdao.core.splines.volume import Volume, evaluate_gradients, volume_basis
from bspline_mdao.generators import brick_grid
from bspline_mdao.grids.cells.bernstein import INVALID, UNDECIDED, VALID
from bspline_mdao.grids.cells.certificate import Certificate, of_statuses
from bspline_mdao.splines import BilinearKnots, ConstantKnots, FunctionKnots
from bspline_mdao.studio.cli.output import show_certificate

COUNTS, ORDER = (6, 5, 7), 4


def curved_volume(rng, spread):
    """A volume with knots that differ from edge to edge."""
    knots = []
    for n in COUNTS:
        corners = np.tile(ConstantKnots.uniform(n, ORDER).knots, (2, 2, 1))
        corners[..., ORDER:n] += spread / (n - ORDER + 1) * rng.uniform(-1.0, 1.0, (2, 2, n - ORDER))
        knots.append(BilinearKnots(corners, ORDER))
    return Volume(tuple(knots))


def bent_net(rng, size):
    """Control points of a stretched and bent box, moved at random by a part of their distances."""
    i, j, k = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in COUNTS), indexing="ij")
    k = k + 0.2 * size * rng.uniform(-1.0, 1.0, i.shape) / COUNTS[2]
    i, j = (x + size * rng.uniform(-1.0, 1.0, i.shape) / n for x, n in ((i, COUNTS[0]), (j, COUNTS[1])))
    height = 1.0 + 1e-3 * (np.exp(4.0 * k) - 1.0)  # thin at the wall
    return np.stack([height * np.cos(i), 3.0 * j, height * np.sin(i)], axis=-1)[:, ::-1]


def least_by_element(volume, net, sign, rng, n):
    """Smallest sampled Jacobian of every element."""
    x = rng.uniform(0.0, 1.0, (n, 3))
    least = np.full([c - ORDER + 1 for c in COUNTS], np.inf)
    np.minimum.at(least, tuple(volume_basis(volume, x)[0].T), sign * np.linalg.det(evaluate_gradients(volume, net, x)))
    return least


@pytest.mark.parametrize("spread", [0.0, 0.05, 0.4])
def test_no_element_of_a_spline_is_falsely_valid_or_invalid(spread):
    rng, counts = np.random.default_rng(int(100 * spread)), np.zeros(3, dtype=int)
    for size in (0.1, 0.4, 0.8):
        volume, net = curved_volume(rng, spread), bent_net(rng, size)
        status = spline_statuses(volume, net, 1)
        sampled = least_by_element(volume, net, 1, rng, 40_000)
        assert (sampled[status == VALID] > 0.0).all()
        assert (status[sampled < 0.0] != VALID).all()
        counts += np.bincount(status.ravel(), minlength=3)
    assert counts[UNDECIDED] < 0.1 * counts.sum()
    assert counts[VALID] > 8
    assert counts[INVALID] > 0


def random_volume(rng):
    """A volume of unequal orders, its control points, those of a thin bent box that are moved, and its handedness."""
    knots, places = [], []
    for order in rng.integers(2, 6, 3):
        n = int(order + rng.integers(0, 4))
        corners = np.tile(ConstantKnots.uniform(n, int(order)).knots, (2, 2, 1))
        corners[..., order:n] += 0.45 / (n - order + 1) * rng.uniform(-1.0, 1.0, (2, 2, n - order))
        knots.append(BilinearKnots(corners, int(order)))
        mean = corners.mean(axis=(0, 1))
        places.append(np.array([mean[i + 1 : i + order].mean() for i in range(n)]))
    i, j, k = np.meshgrid(*places, indexing="ij")
    size = rng.choice([0.02, 0.1, 0.4])
    i, j, k = (x + part * size * rng.uniform(-1.0, 1.0, x.shape) / len(x) for x, part in ((i, 1), (j, 1), (k, 0.2)))
    height = 1.0 + 10.0 ** rng.integers(-5, 0) * (np.exp(4.0 * k) - 1.0)
    net = np.stack([height * np.cos(i), 3.0 * j, height * np.sin(i)], axis=-1)
    sign = int(rng.choice([-1, 1]))
    return Volume(tuple(knots)), np.ascontiguousarray(net[:, ::-1]) if sign > 0 else net, sign


@pytest.mark.slow
def test_nothing_is_falsely_valid_in_volumes_of_any_order_with_knots_that_differ_by_half_a_span():
    rng, n_valid, lows = np.random.default_rng(5), 0, []
    for _ in range(120):
        volume, net, sign = random_volume(rng)
        status = spline_statuses(volume, net, sign)
        x = rng.uniform(0.0, 1.0, (6_000, 3))
        axis = rng.integers(0, 3, 3_000)
        x[np.arange(3_000), axis] = np.round(x[np.arange(3_000), axis])  # on the sides, where folds begin
        gradients = evaluate_gradients(volume, net, x)
        jacobians = sign * np.linalg.det(gradients) / np.linalg.norm(gradients, axis=1).prod(axis=1)
        least = np.full(status.shape, np.inf)
        np.minimum.at(least, tuple(volume_basis(volume, x)[0].T), jacobians)
        assert (least[status == VALID] > -1e-12).all()
        n_valid += np.count_nonzero(status == VALID)
        lows.append(least[status == VALID].min(initial=np.inf))
    assert n_valid > 500
    assert min(lows) < 0.01


def test_no_box_is_proved_where_derivatives_out_of_its_cones_have_a_negative_jacobian():
    rng, n_lanes, n_proved, least = np.random.default_rng(6), 32, 0, np.inf
    for _ in range(60):
        spread = rng.uniform(0.3, 0.7, n_lanes)
        vectors = np.zeros((3, 2, 2, 2, 2, 3, n_lanes))
        vectors[:, 0] = spread * rng.uniform(-1.0, 1.0, (3, 2, 2, 2, 3, n_lanes))
        for v in range(3):
            vectors[v, 0, ..., v, :] += 1.0
        vectors[:, 1] = 0.02 * rng.uniform(0.0, 1.0, (3, 2, 2, 2, 3, n_lanes))
        centres, radii = (part.reshape(3, 8, 3, n_lanes) for part in (vectors[:, 0].copy(), vectors[:, 1].copy()))
        is_there = np.ones(n_lanes, dtype=bool)
        are_positive(vectors, (2, 2, 2), np.zeros((3, 3, 2, n_lanes)), is_there)
        ends = centres + rng.choice([-1.0, 1.0], centres.shape) * radii
        a, b, c = np.meshgrid(*[np.arange(8)] * 3, indexing="ij")
        triples = np.stack([ends[0, a], ends[1, b], ends[2, c]], axis=-2).reshape(512, 3, 3, n_lanes)
        jacobians = np.linalg.det(np.moveaxis(triples, 3, 1))
        assert (jacobians[:, is_there] > 0.0).all()
        n_proved += np.count_nonzero(is_there)
        least = min(least, jacobians[:, is_there].min(initial=np.inf))
    assert n_proved > 100
    assert least < 0.1


@pytest.mark.parametrize("spread", [0.05, 0.4])
def test_curved_knots_alone_leave_a_straight_grid_valid(spread):
    volume = curved_volume(np.random.default_rng(4), spread)
    net = np.stack(np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in COUNTS), indexing="ij"), axis=-1)
    status = spline_statuses(volume, net * [1.0, 1.0, 1e-5], 1)
    assert (status == VALID).all()
    assert (spline_statuses(volume, net * [1.0, 1.0, -1e-5], -1) == status).all()  # left-handed


def test_what_undecided_elements_mean_is_said_where_there_are_any(capsys):
    for status, is_said in ((UNDECIDED, True), (VALID, False)):
        part = of_statuses("block 1", "spline element", np.full((1, 2, 3), status, dtype=np.uint8))
        show_certificate(Certificate((), (part,)))
        assert ("an element is undecided where" in " ".join(capsys.readouterr().out.split())) == is_said


def test_lines_of_a_certificate_say_what_is_proved_and_count_no_blocks():
    model = fit_grid(brick_grid((5, 5, 5, 5)))
    assert certify(model).lines() == [
        "all 384 cells valid: their Jacobian is proved positive everywhere in them, not only at corners",
        "all 6 spline elements valid: their Jacobian is proved positive everywhere between neighbouring knots",
    ]


def test_nothing_is_proved_of_knots_that_are_functions():
    def value(s, t):
        return np.full((s.size, 1), 0.5)

    knots = FunctionKnots(order=3, n_control=4, value=value, gradient=lambda s, t: np.zeros((s.size, 1, 2)))
    volume = Volume((knots, ConstantKnots.uniform(3, 3), ConstantKnots.uniform(2, 2)))
    net = np.stack(np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in (4, 3, 2)), indexing="ij"), axis=-1)
    assert (spline_statuses(volume, net, 1) == UNDECIDED).all()


def test_a_fold_of_a_model_is_named_by_block_and_place():
    model = fit_grid(brick_grid((5, 5, 5, 5)))
    assert certify(model).is_valid
    points = model.control_points.copy()
    ids = model.mesh.control_ids[2]
    points[ids[1, 1, 1]] += 3.0 * (points[ids[-1, -1, -1]] - points[ids[0, 0, 0]])
    found = certify(model, points)
    assert found.status == "invalid"
    assert found.splines[2].status == "invalid"
    assert "spline element" in "\n".join(found.lines())
    assert found.cells[2].n_invalid > 0
    assert len(repr(found)) < 200
    with pytest.raises(InputError, match="a grid has no control points"):
        certify(brick_grid((5, 5, 5, 5)), points)
    with pytest.raises(InputError, match="a str has no cells"):
        certify("wing.xyz")


def test_elements_of_high_order_are_decided():
    knots = tuple(ConstantKnots.uniform(n, n) for n in (17, 18, 17))
    net = np.stack(np.meshgrid(*(np.linspace(0.0, 1.0, k.n_control) for k in knots), indexing="ij"), axis=-1)
    assert (spline_statuses(Volume(knots), net, 1) == VALID).all()
    knots = tuple(ConstantKnots.uniform(40, 16) if e == 0 else ConstantKnots.uniform(17, 17) for e in range(3))
    net = np.stack(np.meshgrid(*(np.linspace(0.0, 1.0, k.n_control) for k in knots), indexing="ij"), axis=-1)
    status = spline_statuses(Volume(knots), net[::-1], 1)
    assert status.shape == (25, 1, 1)
    assert (status == INVALID).all()
