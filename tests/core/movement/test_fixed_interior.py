import numpy as np
from mover_cases import (
    assert_known_points_match,
    bent_surface,
    channel,
    wing,
)

from bspline_mdao.core.movement.fixed_interior import FixedInterior


def test_nothing_moves_but_the_surface():
    mesh = wing()
    initial, surface = bent_surface(mesh)
    points = FixedInterior(mesh, n_increments=3).move(initial, surface).points
    assert_known_points_match(mesh, initial, surface, points)
    inner = np.delete(np.arange(mesh.n_points), mesh.surface_ids)
    np.testing.assert_array_equal(points[inner], initial[inner])


def test_the_report_tells_where_holding_tangles():
    mesh = channel()
    surface = mesh.points[mesh.surface_ids] + [0.0, 0.0, 0.3]  # the first cells are 0.1 high
    report = FixedInterior(mesh, n_increments=4).move(mesh.points, surface).report
    number, worst = report.first_tangled()
    assert len(report.increments) == 4
    assert number == 2
    assert worst.n_tangled == 3 * 4 + 4 * 5
    assert worst.min_corner < 0.0
    assert worst.place.startswith("element (")
    assert all(increment.solve is None for increment in report.increments)
