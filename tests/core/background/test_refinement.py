"""A lattice that is refined for moves that are known."""

import numpy as np
import pytest
from mesh_cases import channel_with_a_floor, mesh_around_two_sections

from bspline_mdao.core.background import refinement
from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.core.background.mesh_walls import FADE
from bspline_mdao.core.background.refinement import narrower, strain_at_walls
from bspline_mdao.errors import InputError


@pytest.fixture(scope="module")
def channel() -> MeshModel:
    """A channel of twenty heights."""
    return MeshModel.of(*channel_with_a_floor())


def with_bump(model: MeshModel, height: float) -> np.ndarray:
    """Nodes of walls with a bump of a twentieth of the length of the channel."""
    walls = model.mesh.points[model.wall_rows].copy()
    walls[:, 1] += np.where(np.abs(walls[:, 0] - 12.0) < 0.5, height * np.cos(np.pi * (walls[:, 0] - 12.0)) ** 2, 0.0)
    return walls


def strain(model: MeshModel, walls: np.ndarray) -> float:
    """The most that the lattice misses of the walls, by the distance over which that fades."""
    before = model.mesh.points[model.wall_rows]
    reach = FADE[1] * np.linalg.norm(np.ptp(before, axis=0))
    return float(strain_at_walls(model.mover, [walls - before], reach).max())


def test_a_short_bump_in_a_long_channel_is_followed_by_a_lattice_that_is_refined_for_it(channel):
    walls = with_bump(channel, 0.2)
    refined = channel.refined_for([walls])
    assert strain(refined, walls) < 0.5 * strain(channel, walls)
    breaks = refined.lattice.lines[0].breaks
    assert np.diff(breaks)[(breaks[:-1] > 11.0) & (breaks[1:] < 13.0)].max() < 1.0
    assert np.diff(breaks).max() > 1.5


def test_a_small_body_that_leaves_a_large_one_inverts_no_cell_where_the_lattice_is_refined_for_it():
    model = MeshModel.of(*mesh_around_two_sections(0.03), LatticeSettings(spacing=0.1))
    walls = model.mesh.points[model.wall_rows].copy()
    walls[np.searchsorted(model.wall_rows, np.unique((model.mesh.markers or {})["flap"])), :2] += [0.1, -0.02]
    n_inverted = []
    for each in (model, model.refined_for([walls])):
        nodes = each.node_map.at(each.mover.move(each.control_points, walls).points).nodes
        n_inverted.append(int(model.mesh.quality(nodes).is_inverted.sum()))
    assert n_inverted[0] > 10
    assert n_inverted[1] == 0


@pytest.mark.parametrize("height", [0.4, 0.6])
def test_a_refined_lattice_that_inverts_more_cells_is_not_taken(channel, height, monkeypatch):
    walls = with_bump(channel, height)
    taken = channel.refined_for([walls]).n_inverted(walls)
    monkeypatch.setattr(MeshModel, "n_inverted", lambda model, _: 0)
    finest = channel.refined_for([walls])
    monkeypatch.undo()
    assert taken <= channel.n_inverted(walls) < finest.n_inverted(walls)


@pytest.mark.slow
def test_a_lattice_is_refined_for_all_moves_and_no_further_than_they_ask(channel):
    small, large = with_bump(channel, 1e-3), with_bump(channel, 0.1)
    assert channel.refined_for([small]) is channel
    assert channel.refined_for([small, large]).settings == channel.refined_for([large]).settings
    assert channel.refined_for([large]).settings == channel.refined_for([large]).settings
    again = channel.refined_for([large])
    assert again.refined_for([large]).lattice.shape == again.lattice.shape
    assert MeshModel.of(channel.mesh, channel.kinds, again.settings).lattice.shape == again.lattice.shape
    with pytest.raises(InputError, match="nodes of walls"):
        channel.refined_for([large[1:]])


def test_a_lattice_that_moves_would_make_too_large_stays(channel, monkeypatch):
    monkeypatch.setattr(refinement, "WITHOUT_ASKING", 0.0)
    assert channel.refined_for([with_bump(channel, 0.2)]) is channel


def test_spans_are_halved_where_walls_go_through_them(channel):
    walls = channel.mesh.points[channel.wall_rows]
    near = walls[np.abs(walls[:, 0] - 12.0) < 0.5]
    asked = narrower(channel.lattice, near)
    assert {part[0] for part in asked} == {0, 1}
    for axis, low, high, width in asked:
        assert width == pytest.approx(0.5 * (high - low))
        assert ((near[:, axis] >= low) & (near[:, axis] <= high)).any()
    along = [part for part in asked if part[0] == 0]
    assert min(low for _, low, _, _ in along) <= 11.6
    assert max(high for _, _, high, _ in along) >= 12.4
