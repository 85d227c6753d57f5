"""Parts of a mesh without structure that processes hold: nodes and products are those of the whole."""

import numpy as np
import pytest
from mesh_cases import body_model, periodic_model, section_model, sector_model, smooth_change

from bspline_mdao.grids.topology.partition import Subdomain


@pytest.mark.parametrize("made", [body_model, section_model, periodic_model, sector_model])
def test_nodes_and_products_of_parts_are_those_of_the_whole(made):
    model, rng = made(), np.random.default_rng(4)
    change = smooth_change(model, rng, 0.03)
    points = model.mover.move(model.control_points, model.mesh.points[model.wall_rows] + change).points
    whole, direction = model.node_map.at(points), rng.standard_normal(points.shape)
    change, bar = whole.jvp(direction), rng.standard_normal(whole.nodes.shape)
    dealt = [model.partition(2).subdomain(rank).rows for rank in range(2)]
    mixed = rng.permutation(model.n_nodes)[: model.n_nodes // 3]
    total = 0.0
    for rows in (*dealt, mixed, np.concatenate([mixed[:7], mixed[:3]]), np.zeros(0, dtype=int)):
        part = model.part(Subdomain.of_rows(rows, model.n_nodes)).node_map
        state = part.at(points)
        assert part.n_asked == len(rows)
        np.testing.assert_allclose(part.nodes, model.mesh.points[rows], rtol=0, atol=0)
        np.testing.assert_allclose(state.nodes, whole.nodes[rows], rtol=0, atol=1e-13)
        np.testing.assert_allclose(state.jvp(direction), change[rows], rtol=0, atol=1e-12)
        found = np.vdot(state.vjp(part.padded(bar[rows]))["control_points"], direction)
        assert found == pytest.approx(np.vdot(bar[rows], change[rows]), abs=1e-10)
        total = total + (state.vjp(bar[rows])["control_points"] if rows is dealt[0] or rows is dealt[1] else 0.0)
    expected = whole.vjp(bar)["control_points"]
    np.testing.assert_allclose(total, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_a_part_knows_few_nodes_besides_its_own_and_those_of_walls():
    model = body_model()
    part = model.part(model.partition(5).subdomain(1)).node_map
    assert part.embedded.n_points <= part.n_asked + len(model.wall_rows)
    assert part.embedded.evaluator.n_rows <= part.n_asked + len(model.wall_rows)
