"""Volumes that share control points."""

import numpy as np
import pytest

from bspline_mdao.core.splines.knots import ConstantKnots
from bspline_mdao.core.splines.mesh import BSplineMesh
from bspline_mdao.core.splines.volume import Volume, evaluate
from bspline_mdao.errors import InputError

VOLUME = Volume(tuple(ConstantKnots.uniform(n, p) for n, p in ((4, 4), (5, 3), (6, 2))))


def two_volumes():
    """The second volume begins where the first ends in xi: they share a face of 5 x 6 control points."""
    first = np.arange(4 * 5 * 6).reshape(4, 5, 6)
    second = first + 3 * 5 * 6
    return BSplineMesh((VOLUME, VOLUME), (first, second), 7 * 5 * 6)


def test_volumes_meet_on_the_points_they_share():
    mesh = two_volumes()
    nets = mesh.nets(np.random.default_rng(0).standard_normal((mesh.n_control_points, 3)))
    st = np.random.default_rng(1).uniform(size=(20, 2))
    end = evaluate(VOLUME, nets[0], np.column_stack([np.ones(20), st]))
    start = evaluate(VOLUME, nets[1], np.column_stack([np.zeros(20), st]))
    np.testing.assert_array_equal(end, start)


@pytest.mark.parametrize(
    ("volumes", "ids", "n", "message"),
    [
        ((VOLUME, VOLUME), [np.arange(120).reshape(4, 5, 6)], 120, "2 volumes and 1 arrays"),
        ((VOLUME,), [np.arange(120).reshape(6, 5, 4)], 120, "ids of shape"),
        ((VOLUME,), [np.arange(120.0).reshape(4, 5, 6)], 120, "give integers"),
        ((VOLUME,), [np.arange(120).reshape(4, 5, 6)], 119, "keep them within 0 and 118"),
        ((VOLUME,), [np.arange(120).reshape(4, 5, 6) - 1], 120, "run from -1"),
        ((VOLUME,), [np.arange(120).reshape(4, 5, 6)], 121, "control point 121 of 121 belongs to no volume"),
    ],
)
def test_parts_that_do_not_fit_together_are_refused(volumes, ids, n, message):
    with pytest.raises(InputError, match=message):
        BSplineMesh(volumes, ids, n)
