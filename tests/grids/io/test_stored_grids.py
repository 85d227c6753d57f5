"""Grids that stay in their file: blocks and windows of them are read when they are asked for."""

import pickle
import tracemalloc
from itertools import product

import numpy as np
import pytest
from grid_cases import assert_same_grid, smooth_grid, smooth_nodes

from bspline_mdao import InputError, open_grid, read_grid, write_grid
from bspline_mdao.grids.io import fortran
from bspline_mdao.grids.io.patches import read_patches
from bspline_mdao.grids.io.plot3d import write_plot3d
from bspline_mdao.grids.io.plot3d_dialect import Plot3dDialect
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window

DIALECTS = [
    Plot3dDialect(encoding, layout=layout, has_iblank=blank, compression=zipped, **rest)
    for encoding, rest in (
        ("ascii", {}),
        ("raw", {"byte_order": ">", "real_bytes": 4}),
        ("fortran", {"records": "array"}),
        ("fortran", {"byte_order": ">", "marker_bytes": 8}),
    )
    for layout, blank, zipped in product(("whole", "planes"), (False, True), ("", "gzip"))
]
WINDOWS = [Window(0, (0, 0, 0), (3, 4, 5)), Window(1, (1, 0, 2), (1, 3, 4)), Window(1, (2, 1, 0), (5, 3, 0))]


def assert_same_block(one, other):
    assert one.name == other.name
    assert_same_grid(Grid((one,)), Grid((other,)))


def cut(grid, window):
    block = grid.blocks[window.block]
    iblank = None if block.iblank is None else block.iblank[window.slices]
    return Block(block.nodes[window.slices], block.name, iblank)


@pytest.mark.parametrize("dialect", DIALECTS, ids=str)
def test_blocks_and_windows_of_plot3d_are_those_of_the_whole_grid(dialect, tmp_path, monkeypatch):
    monkeypatch.setattr(fortran, "TEXT_PART", 997)  # text in many parts
    write_plot3d(tmp_path / "grid", smooth_grid(has_iblank=dialect.has_iblank), dialect)
    whole = read_grid(tmp_path / "grid")
    stored = pickle.loads(pickle.dumps(open_grid(tmp_path / "grid")))
    assert (stored.dialect, stored.shapes, stored.n_nodes) == (whole.dialect, whole.shapes, whole.n_nodes)
    assert_same_grid(stored.grid(), whole)
    for window in WINDOWS:
        assert_same_block(stored.read(window), cut(whole, window))
    assert_same_block(read_grid(tmp_path / "grid", blocks=[1]).blocks[0], whole.blocks[1])


def test_blocks_and_windows_of_cgns_keep_patches_and_connections(tmp_path):
    walls = (Window(0, (0, 0, 0), (0, 4, 5)), Window(1, (0, 0, 0), (5, 0, 4)))
    grid = Grid(smooth_grid().blocks, (Patch("wing", "wall", walls), Patch("far", "farfield", walls[:0])))
    write_grid(tmp_path / "grid.cgns", grid)
    whole, stored = read_grid(tmp_path / "grid.cgns"), open_grid(tmp_path / "grid.cgns")
    assert (stored.patches, stored.connections, stored.dialect) == (whole.patches, whole.connections, whole.dialect)
    assert_same_grid(stored.grid(), whole)
    for window in WINDOWS:
        assert_same_block(stored.read(window), cut(whole, window))
    second = read_grid(tmp_path / "grid.cgns", blocks=[1])
    assert_same_block(second.blocks[0], whole.blocks[1])
    assert second.patches == (Patch("wing", "wall", (Window(0, (0, 0, 0), (5, 0, 4)),)),)


def test_a_patches_file_belongs_to_a_stored_grid_as_to_one_in_memory(tmp_path):
    write_plot3d(tmp_path / "grid", smooth_grid())
    (tmp_path / "p.toml").write_text('[[patch]]\nname = "wing"\nkind = "wall"\nfaces = [{block = 2, face = "jmin"}]\n')
    whole, stored = read_grid(tmp_path / "grid", tmp_path / "p.toml"), open_grid(tmp_path / "grid", tmp_path / "p.toml")
    assert stored.patches == whole.patches == read_patches(tmp_path / "p.toml", open_grid(tmp_path / "grid")).patches


def message_of(read, path):
    with pytest.raises(InputError) as caught:
        read(path)
    return str(caught.value)


@pytest.mark.parametrize("encoding", ["ascii", "raw", "fortran"])
def test_damage_is_told_of_as_by_the_reader_of_whole_grids(encoding, tmp_path):
    path = tmp_path / "grid"
    write_plot3d(path, smooth_grid(), Plot3dDialect(encoding))
    content = path.read_bytes()
    path.write_bytes(content[:-40])
    assert message_of(open_grid, path) == message_of(read_grid, path)
    path.write_bytes(content[: len(content) // 2] + b"oops" + content[len(content) // 2 :])
    assert message_of(open_grid, path) == message_of(read_grid, path)


def test_a_wrong_word_far_down_a_text_is_named_with_its_line(tmp_path, monkeypatch):
    monkeypatch.setattr(fortran, "TEXT_PART", 500)
    write_plot3d(tmp_path / "grid", smooth_grid(), Plot3dDialect("ascii"))
    lines = (tmp_path / "grid").read_text().splitlines()
    lines[70] = lines[70].replace(".", "n.", 1)
    (tmp_path / "grid").write_text("\n".join(lines))
    assert "line 71" in message_of(open_grid, tmp_path / "grid")
    assert message_of(open_grid, tmp_path / "grid") == message_of(read_grid, tmp_path / "grid")


def test_a_node_that_is_not_finite_is_named_when_its_block_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr("bspline_mdao.grids.io.plot3d._NODES_JUDGED", 30)  # the damage is beyond what is judged
    grid = smooth_grid()
    nodes = grid.blocks[1].nodes.copy()
    write_plot3d(tmp_path / "grid", grid)
    nodes[4, 2, 3, 1] = np.nan
    monkeypatch.setattr("bspline_mdao.grids.io.plot3d.find_fault", lambda blocks, *_: None)
    write_plot3d(tmp_path / "grid", Grid((grid.blocks[0], Block(nodes, "block 2"))))
    monkeypatch.undo()
    monkeypatch.setattr("bspline_mdao.grids.io.plot3d._NODES_JUDGED", 30)
    stored = open_grid(tmp_path / "grid")
    assert_same_block(stored.read(WINDOWS[0]), cut(grid, WINDOWS[0]))
    expected = message_of(read_grid, tmp_path / "grid")
    assert "block 2: node (5, 3, 4) has y = nan" in expected
    assert message_of(lambda path: open_grid(path).grid([1]), tmp_path / "grid") == expected
    assert message_of(lambda path: stored.read(Window(1, (3, 1, 2), (4, 3, 3))), tmp_path / "grid") == expected


def test_a_file_that_has_become_shorter_is_named(tmp_path):
    write_plot3d(tmp_path / "grid", smooth_grid())
    stored = open_grid(tmp_path / "grid")
    (tmp_path / "grid").write_bytes((tmp_path / "grid").read_bytes()[:900])
    with pytest.raises(InputError, match="has become shorter"):
        stored.grid()


@pytest.mark.parametrize("blocks", [[2], [-1], [0, 0]])
def test_blocks_that_are_not_there_are_refused(blocks, tmp_path):
    write_plot3d(tmp_path / "grid", smooth_grid())
    with pytest.raises(InputError, match="block"):
        read_grid(tmp_path / "grid", blocks=blocks)


def test_a_window_that_reaches_out_of_its_block_is_refused(tmp_path):
    write_plot3d(tmp_path / "grid", smooth_grid())
    with pytest.raises(InputError, match="no window"):
        open_grid(tmp_path / "grid").read(Window(0, (0, 0, 0), (4, 4, 5)))


@pytest.mark.parametrize("dialect", [Plot3dDialect(), Plot3dDialect("fortran"), None], ids=str)
def test_a_block_takes_the_memory_of_a_block(dialect, tmp_path, monkeypatch):
    monkeypatch.setattr("bspline_mdao.grids.io.plot3d._NODES_JUDGED", 1000)  # so that the grid is a large one
    blocks = tuple(Block(smooth_nodes((40, 40, 40), 4.0 * n), f"block {n}") for n in range(1, 13))
    path = tmp_path / ("grid" if dialect else "grid.cgns")
    write_grid(path, Grid(blocks, dialect=dialect))
    open_grid(path).read(Window(5, (0, 0, 0), (1, 1, 1)))
    tracemalloc.start()
    open_grid(path).grid([7])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3.5 * blocks[0].nodes.nbytes
