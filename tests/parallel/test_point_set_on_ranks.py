"""Structures inside the body, and meshes that ride along, follow the design variables on several ranks."""

import pytest
from parallel_cases import run_ranks

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("n", [2, 3])
def test_points_inside_a_body_move_alike_on_all_ranks(n):
    run_ranks("cases/point_set.py", n)


def test_a_mesh_rides_along_alike_on_all_ranks():
    run_ranks("cases/ride.py", 2)
