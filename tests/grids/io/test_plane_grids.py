"""Plane grids, one node deep, become one cell deep in commands and are written back plane."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bspline_mdao import InputError, find_topology, read_grid, write_grid
from bspline_mdao.files import lift_plane_grid
from bspline_mdao.grids.io.patch_guess import guess_faces
from bspline_mdao.grids.io.plane_grids import flattened
from bspline_mdao.grids.io.plot3d_dialect import Plot3dDialect
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.studio.cli.main import run

ROOT = np.linspace(0.0, 1.0, 17)


def channel(flat=2, turn=None, offset=0.0):
    """A channel over a bump in a plane: two blocks, one after the other, a single node in one direction of each."""
    turn = np.eye(3) if turn is None else turn
    x, y = np.meshgrid(np.linspace(0.0, 4.0, 25), ROOT**2, indexing="ij")
    nodes = np.stack([x, y + (1.0 - y) * 0.2 * np.exp(-4.0 * (x - 2.0) ** 2), offset + 0.0 * x], axis=-1) @ turn.T
    parts = [np.expand_dims(part, flat) for part in (nodes[:14], nodes[13:])]
    blocks = tuple(Block(part, f"block {n + 1}") for n, part in enumerate(parts))
    floor = []
    for number, block in enumerate(blocks):
        window = Window.whole(number, block.shape)
        up = [d for d in range(3) if d != flat][1]
        floor.append(replace(window, hi=tuple(0 if d == up else n for d, n in enumerate(window.hi))))
    return Grid(blocks, (Patch("floor", "wall", tuple(floor)),), source="channel.xyz")


@pytest.mark.parametrize("flat", [0, 1, 2])
@pytest.mark.parametrize("seed", [None, 0, 1])
def test_a_plane_grid_in_any_direction_becomes_one_cell_deep_and_plane_again(flat, seed):
    turn = np.eye(3) if seed is None else Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    grid = channel(flat, turn, offset=0.7)
    deep = lift_plane_grid(grid, height=0.25)
    assert all(shape[flat] == 2 for shape in deep.shapes)
    for block in deep.blocks:
        step = np.diff(block.nodes, axis=flat)
        np.testing.assert_allclose(step, np.broadcast_to(step.reshape(-1, 3)[0], step.shape), atol=1e-14)
        np.testing.assert_allclose(np.abs(step @ turn[:, 2]), 0.25, atol=1e-14)
        edges = [np.diff(block.nodes, axis=d)[0, 0, 0] for d in range(3)]
        assert np.linalg.det(edges) > 0.0
    windows = [window for patch in deep.patches for window in patch.windows]
    assert [(w.lo[flat], w.hi[flat]) for w in windows] == [(0, 1)] * 2
    topology = find_topology(deep)
    assert (len(topology.interfaces), topology.warnings) == (1, ())
    guesses = guess_faces(deep, [face.window for face in topology.boundary if face.patch is None])
    sides = [guess for guess in guesses if guess.window.lo[flat] == guess.window.hi[flat]]
    assert [(guess.kind, guess.level) for guess in sides] == [("symmetry", "sure")] * 4
    plane = flattened(deep)
    for one, other in zip(plane.blocks, grid.blocks):
        np.testing.assert_allclose(one.nodes, other.nodes, rtol=0.0, atol=1e-15)
    assert plane.dialect is grid.dialect


def test_surfaces_and_grids_with_depth_stay_as_they_are():
    grid = channel()
    bent = [
        replace(block, nodes=block.nodes + 1e-3 * block.nodes[..., :1] ** 2 * [0.0, 0.0, 1.0]) for block in grid.blocks
    ]
    surface = replace(grid, blocks=tuple(bent))
    assert lift_plane_grid(surface) is surface
    deep = lift_plane_grid(grid)
    assert lift_plane_grid(deep) is deep
    assert flattened(surface) is surface
    with pytest.raises(InputError, match="give a height that is positive"):
        lift_plane_grid(grid, height=0.0)


def test_a_lifted_grid_that_has_left_its_plane_is_not_written(tmp_path):
    deep = lift_plane_grid(channel())
    nodes = deep.blocks[1].nodes.copy()
    nodes[3, 4, 0, 2] += 0.01
    with pytest.raises(InputError, match=r"its nodes have left the plane by 0\.01 m"):
        write_grid(tmp_path / "a.xyz", replace(deep, blocks=(deep.blocks[0], replace(deep.blocks[1], nodes=nodes))))
    assert not list(tmp_path.iterdir())


def test_openfoam_gets_the_cell_and_all_others_the_plane(tmp_path):
    deep = lift_plane_grid(channel())
    for name in ("a.xyz", "a.fmt", "a.cgns"):
        write_grid(tmp_path / name, deep)
        assert read_grid(tmp_path / name).shapes == channel().shapes
    write_grid(tmp_path / "polyMesh", deep, find_topology(deep))
    assert (tmp_path / "polyMesh" / "points").exists()


@pytest.mark.parametrize(
    "dialect",
    [Plot3dDialect("ascii", n_dimensions=2), Plot3dDialect("fortran", n_dimensions=2, real_bytes=8), Plot3dDialect()],
    ids=["text of two dimensions", "records of two dimensions", "three dimensions"],
)
def test_commands_move_a_plane_grid_and_write_it_as_it_was(tmp_path, monkeypatch, dialect):
    monkeypatch.chdir(tmp_path)
    write_grid("plane.xyz", replace(channel(), dialect=dialect, patches=()))
    at_rest = read_grid("plane.xyz")
    assert run(["inspect", "plane.xyz", "--draft", "draft.toml"]) == 0
    text = (tmp_path / "draft.toml").read_text()
    assert 'name = "symmetry_z"' in text
    (tmp_path / "p.toml").write_text(
        '[[patch]]\nname = "floor"\nkind = "wall"\nfaces = [{block = 1, face = "jmin"}, {block = 2, face = "jmin"}]\n'
        '[[patch]]\nname = "sides"\nkind = "symmetry"\nfaces = [{block = 1, face = "kmin"}, '
        '{block = 1, face = "kmax"}, {block = 2, face = "kmin"}, {block = 2, face = "kmax"}]\n'
    )
    assert run(["fit", "plane.xyz", "-o", "plane.h5", "--patches", "p.toml"]) == 0
    assert run(["move", "plane.h5", "--deform", "bumps=0.02,seed=2,wavelength=2", "-o", "moved.xyz"]) == 0
    moved = read_grid("moved.xyz")
    assert (moved.shapes, moved.dialect) == (at_rest.shapes, at_rest.dialect)
    change = np.concatenate([(m.nodes - b.nodes).reshape(-1, 3) for m, b in zip(moved.blocks, at_rest.blocks)])
    assert (change[:, 2] == 0.0).all()
    assert 0.005 < np.abs(change[:, :2]).max() < 0.1
    assert run(["refine", "plane.h5", "--factor", "2", "-o", "fine.xyz"]) == 0
    assert read_grid("fine.xyz").shapes == ((27, 33, 1), (23, 33, 1))
    assert run(["quality", "plane.xyz", "--json", "q.json"]) == 0
