"""PLOT3D grids in every dialect."""

import bz2
import gzip
import lzma
import os
import struct
import tracemalloc
from itertools import product

import numpy as np
import pytest
from grid_cases import assert_same_grid, smooth_grid, smooth_nodes

from bspline_mdao.errors import InputError
from bspline_mdao.grids.io.files import read_grid, write_grid
from bspline_mdao.grids.io.fortran import parse_numbers
from bspline_mdao.grids.io.plot3d import open_plot3d, read_plot3d, write_plot3d
from bspline_mdao.grids.io.plot3d_dialect import Plot3dDialect
from bspline_mdao.grids.topology.grid import Block, Grid

CONTAINERS = (
    [{"encoding": "ascii"}]
    + [{"encoding": "raw", "byte_order": order, "real_bytes": size} for order, size in product("<>", (4, 8))]
    + [
        {"encoding": "fortran", "byte_order": order, "real_bytes": size, "marker_bytes": marker, "records": records}
        for order, size, marker, records in product("<>", (4, 8), (4, 8), ("block", "plane", "array"))
    ]
)
CONTENTS = [
    {"has_block_count": count, "n_dimensions": n, "has_iblank": blank, "layout": layout, "compression": zipped}
    for count, n, blank, layout, zipped in product(
        (True, False), (3, 2), (False, True), ("whole", "planes"), ("", "gzip")
    )
    if not (n == 2 and layout == "planes")
]
DIALECTS = [
    Plot3dDialect(**container, **content)
    for container, content in product(CONTAINERS, CONTENTS)
    if not (container.get("records") == "plane" and content["layout"] == "whole")
]


def grid_for(dialect):
    shapes = ((4, 5, 6), (6, 4, 5)) if dialect.n_dimensions == 3 else ((5, 7, 1), (6, 4, 1))
    shapes = shapes if dialect.has_block_count else shapes[:1]
    return smooth_grid(shapes, dialect.n_dimensions, dialect.has_iblank)


@pytest.mark.slow
def test_every_dialect_is_detected_and_comes_back_byte_for_byte(tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    for dialect in DIALECTS:
        grid = grid_for(dialect)
        write_plot3d(first, grid, dialect)
        read = read_plot3d(first)
        assert read.dialect == dialect
        assert_same_grid(read, grid)
        write_plot3d(second, read)
        assert second.read_bytes() == first.read_bytes()


RARE_HEADERS = [
    ("fortran", header, size)
    for header, size in product(("apart", "joined", "rows", "spread"), (4, 8))
    if (header, size) != ("apart", 4)
] + [("raw", "apart", 8), ("raw", "spread", 4), ("raw", "spread", 8), ("ascii", "spread", 4)]


@pytest.mark.parametrize(("encoding", "header", "size"), RARE_HEADERS)
def test_every_header_met_in_the_wild_is_detected_and_comes_back_byte_for_byte(tmp_path, encoding, header, size):
    first, second = tmp_path / "first", tmp_path / "second"
    contents = product(
        "<>", (4, 8), (3, 2), (False, True), ("whole", "planes") if encoding != "fortran" else ("whole",)
    )
    for order, real, n_dimensions, blank, layout in contents:
        if n_dimensions == 2 and layout == "planes":
            continue
        binary = {} if encoding == "ascii" else {"byte_order": order, "real_bytes": real, "integer_bytes": size}
        dialect = Plot3dDialect(
            encoding, header=header, n_dimensions=n_dimensions, has_iblank=blank, layout=layout, **binary
        )
        grid = grid_for(dialect)
        write_plot3d(first, grid, dialect)
        for read in (read_plot3d(first), open_plot3d(first).grid()):
            assert read.dialect == dialect
            assert_same_grid(read, grid)
        write_plot3d(second, read)
        assert second.read_bytes() == first.read_bytes()


def record(*arrays):
    """Bytes of a Fortran record."""
    payload = b"".join(array.tobytes() for array in arrays)
    return struct.pack("<i", len(payload)) + payload + struct.pack("<i", len(payload))


def test_headers_as_others_write_them_are_read(tmp_path):
    """The bytes are put together here, block by block."""
    grid, path = smooth_grid(((4, 5, 6), (6, 4, 5), (3, 3, 4))), tmp_path / "grid"
    for kind in (np.int32, np.int64):
        count, rows = kind(len(grid.blocks)), [np.array(shape, kind) for shape in grid.shapes]
        data = [block.nodes.transpose(3, 2, 1, 0).astype(np.float32) for block in grid.blocks]
        one_of_each = [piece for row, nodes in zip(rows, data) for piece in (row, nodes)]
        files = {
            "joined": record(count, *rows) + b"".join(map(record, data)),
            "rows": record(count) + b"".join(map(record, rows)) + b"".join(map(record, data)),
            "spread": record(count) + b"".join(map(record, one_of_each)),
            "raw": b"".join(array.tobytes() for array in (count, *one_of_each)),
        }
        for content in files.values():
            path.write_bytes(content)
            assert_same_grid(read_plot3d(path), grid)
    path.write_bytes(record(np.int32(1), np.int32([4, 5, 6])) + record(data[0]))  # one block, in one record
    assert read_plot3d(path).dialect.header == "joined"


def test_counts_that_are_no_sizes_of_the_file_are_refused_in_no_time(tmp_path):
    path = tmp_path / "grid"
    for kind in (np.int32, np.int64):
        for counts in ([2**31 - 1, 1, 1, 1], [3, 2**20, 2**20, 2**20], [2, 4, 5, 0]):
            path.write_bytes(np.array(counts, kind).tobytes() + bytes(5000))
            assert "PLOT3D" in refusal(path)


def test_comments_in_a_text_are_passed_over_and_said(tmp_path, monkeypatch):
    grid, path = smooth_grid(), tmp_path / "grid.fmt"
    write_plot3d(path, grid, Plot3dDialect("ascii"))
    plain = path.read_text()
    path.write_text("# wing, 12*4 nodes; x = 1.5\n" + plain.replace("\n", " ! 1 2 3\n", 40) + "# end")
    monkeypatch.setattr("bspline_mdao.grids.io.fortran.TEXT_PART", 200)  # parts end anywhere
    for read in (read_plot3d(path), open_plot3d(path).grid()):
        assert_same_grid(read, grid)
        assert read.dialect.ignored == (f"{path}: 42 comments in the text, not kept when the grid is written",)
    write_plot3d(path, read)
    assert path.read_text() == plain


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "suffix", "compress"), [("gzip", ".gz", gzip), ("bzip2", ".bz2", bz2), ("xz", ".xz", lzma)]
)
def test_compressed_grids_are_read_and_written_as_named(tmp_path, name, suffix, compress):
    grid, path = smooth_grid(), tmp_path / f"grid.fmt{suffix}"
    write_grid(path, grid)
    assert_same_grid(read_grid(path), grid)
    assert read_grid(path).dialect == Plot3dDialect("ascii", compression=name)
    first = path.read_bytes()
    assert compress.decompress(first).startswith(b"2\n4 5 6")
    write_grid(path, read_grid(path))
    assert path.read_bytes() == first
    path.write_bytes(first + compress.compress(b" "))  # two members, one after the other
    assert_same_grid(open_plot3d(path).grid(), grid)
    path.write_bytes(first[:-20])
    assert f"damaged {name} file (it ends in the middle)" in refusal(path)
    path.write_bytes(first[:200] + bytes(200) + first[400:])
    assert f"damaged {name} file" in refusal(path)
    path.write_bytes(compress.compress(bytes(2**26 + 1)))
    assert "grows from" in refusal(path)


def test_a_large_grid_is_not_taken_for_a_flat_one_in_another_layout(tmp_path, monkeypatch):
    monkeypatch.setattr("bspline_mdao.grids.io.plot3d._NODES_JUDGED", 100)  # a few planes, as of a grid of millions
    nodes = smooth_nodes((21, 21, 31)) * [1.0, 1.0, 3.0]
    for layout in ("whole", "planes"):
        grid = Grid((Block(nodes, "block 1"),))
        write_plot3d(tmp_path / "grid", grid, Plot3dDialect("raw", layout=layout))
        assert_same_grid(read_plot3d(tmp_path / "grid"), grid)


@pytest.mark.parametrize("x_is_flat", [False, True])
def test_iblank_in_the_plane_is_not_taken_for_z(tmp_path, x_is_flat):
    """The header 1 ni nj is that of one 2-D block, or of one 3-D block of one node in i without block count."""
    nodes = smooth_nodes((6, 5, 1), n_dimensions=2)
    flat = Grid((Block(nodes.transpose(2, 0, 1, 3), "block 1"),))
    blanked = Grid((Block(nodes, "block 1", np.ones((6, 5, 1), np.int32)),))
    for encoding in ("ascii", "raw", "fortran"):
        options = {"has_block_count": False} if x_is_flat else {"n_dimensions": 2, "has_iblank": True}
        write_plot3d(tmp_path / "grid", flat if x_is_flat else blanked, Plot3dDialect(encoding, **options))
        assert_same_grid(read_plot3d(tmp_path / "grid"), flat if x_is_flat else blanked)


def test_double_precision_survives_every_encoding(tmp_path):
    nodes = smooth_nodes((4, 5, 6)) + np.random.default_rng(1).normal(size=(4, 5, 6, 3)) * 1e-9
    grid = Grid((Block(nodes, "block 1"),))
    for encoding in ("ascii", "fortran", "raw"):
        write_plot3d(tmp_path / "grid", grid, Plot3dDialect(encoding))
        assert_same_grid(read_plot3d(tmp_path / "grid"), grid)


def test_single_planes_and_lines_and_two_plane_blocks_are_read(tmp_path):
    for shapes in [((9, 7, 1), (9, 1, 7)), ((2, 31, 41), (2, 31, 7)), ((21, 15, 2),), ((1, 9, 8),)]:
        for encoding in ("ascii", "fortran", "raw"):
            grid = smooth_grid(shapes)
            write_plot3d(tmp_path / "grid", grid, Plot3dDialect(encoding))
            read = read_plot3d(tmp_path / "grid")
            assert_same_grid(read, grid)
            assert read.dialect == Plot3dDialect(encoding)


def test_ascii_repeats_commas_and_exponents_are_those_of_fortran():
    text = b" 2*1.5, 3*-2,\n1.5D-3 1.5d+03\t-1.25Q2 1.5-103 ;7 +.5 0.E+0 NaN\r\n\x1a"
    expected = [1.5, 1.5, -2, -2, -2, 1.5e-3, 1.5e3, -125.0, 1.5e-103, 7, 0.5, 0, np.nan]
    np.testing.assert_array_equal(parse_numbers(text, "text"), expected)


@pytest.mark.parametrize(
    "text",
    [
        b"1 2 x",
        b"1.2.3",
        b"1 * 2",
        b"1 *2",
        b"2*",
        b"*3",
        b"0*1",
        b"1.5*2",
        b"2*3*4",
        b"1--2",
        b"*****",
        b"99999999999999*1",
    ],
)
def test_text_that_is_no_number_is_refused_in_one_line(text):
    with pytest.raises(InputError, match=r"^text: [^\n]+$"):
        parse_numbers(text, "text")


def test_header_may_hold_repeats(tmp_path):
    (tmp_path / "grid").write_bytes(b"1 3*2 4*0 4*1. 2*(0,1)".replace(b"2*(0,1)", b"2*0 2*1 2*0 2*1 0 1 0 1 0 1 0 1"))
    assert read_plot3d(tmp_path / "grid").shapes == ((2, 2, 2),)


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_plot3d(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message


@pytest.mark.parametrize("encoding", ["ascii", "fortran", "raw"])
def test_truncated_file_is_named_so(tmp_path, encoding):
    path = tmp_path / "grid"
    write_plot3d(path, smooth_grid(), Plot3dDialect(encoding))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    message = refusal(path)
    assert encoding == "fortran" or "truncated" in message


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
@pytest.mark.parametrize("encoding", ["ascii", "fortran", "raw"])
def test_node_that_is_no_number_is_named_by_block_and_index(tmp_path, encoding, bad):
    path = tmp_path / "grid"
    grid = smooth_grid()
    write_plot3d(path, grid, Plot3dDialect(encoding))
    marker = grid.blocks[1].nodes[2, 1, 3, 1]
    data = path.read_bytes()
    if encoding == "ascii":
        data = data.replace(repr(float(marker)).encode(), repr(bad).encode())
    else:
        data = data.replace(struct.pack("<d", marker), struct.pack("<d", bad))
    path.write_bytes(data)
    assert "block 2: node (3, 2, 4) has y" in refusal(path)


def test_huge_counts_reserve_no_memory(tmp_path):
    path = tmp_path / "grid"
    path.write_bytes(struct.pack("<4i", 1, 2**31 - 1, 2**31 - 1, 2**31 - 1) + bytes(200))
    tracemalloc.start()
    refusal(path)
    path.write_bytes(struct.pack("<i", 2**31 - 1) + bytes(200))
    refusal(path)
    path.write_bytes(b"1 1000000 1000000 10 30000000000000*0.5")
    refusal(path)
    assert tracemalloc.get_traced_memory()[1] < 5e7
    tracemalloc.stop()


@pytest.mark.slow
def test_gzip_bomb_and_damaged_gzip_are_refused(tmp_path):
    path = tmp_path / "grid.gz"
    path.write_bytes(gzip.compress(bytes(200_000_000), 1))
    assert "grows" in refusal(path)
    path.write_bytes(gzip.compress(os.urandom(1000))[:-20])
    assert "damaged gzip" in refusal(path)


def test_missing_empty_and_foreign_files_are_refused(tmp_path):
    assert "does not exist" in refusal(tmp_path / "none")
    assert "not a file" in refusal(tmp_path)
    (tmp_path / "empty").write_bytes(b"")
    assert "empty" in refusal(tmp_path / "empty")
    (tmp_path / "foreign").write_bytes(np.random.default_rng(3).bytes(5000))
    refusal(tmp_path / "foreign")


def test_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "grid"
    write_plot3d(path, smooth_grid())
    before = path.read_bytes()
    nodes = smooth_nodes((3, 3, 3))
    nodes[1, 1, 1, 0] = np.nan
    for grid, dialect in [
        (Grid((Block(nodes, "block 1"),)), None),
        (smooth_grid(), Plot3dDialect(has_block_count=False)),
        (smooth_grid(), Plot3dDialect(n_dimensions=2)),
    ]:
        with pytest.raises(InputError):
            write_plot3d(path, grid, dialect)
    with pytest.raises(InputError, match="cannot be written"):
        write_plot3d(path / "grid", smooth_grid())
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["grid"]


REAL_SHAPES = {
    "cfl3d_axibump.fmt": (1, (2, 181, 101), 36_562),
    "cfl3d_rotorstator.fmt": (14, (2, 55, 23), 36_748),
    "cfl3d_ejector_nozzle.p3dfmt": (3, (2, 31, 41), 31_386),
    "cfl3d_naca0012_cgrid.fmt": (1, (2, 257, 129), 66_306),
    "cfl3d_cylinder_ogrid.fmt": (1, (2, 129, 81), 20_898),
    "cfl3d_delta_wing.fmt.gz": (1, (37, 65, 65), 156_325),
    "aither_multiblock_cylinder.xyz": (2, (33, 2, 41), 5_412),
    "aither_rae2822.xyz": (1, (369, 65, 2), 47_970),
    "multi-ascii.xyz": (2, (8, 12, 12), 2_304),
    "multi-bin.xyz": (2, (8, 12, 12), 2_304),
    "multi-bin-C.xyz": (2, (8, 12, 12), 2_304),
    "vtk_bluntfin.bin": (1, (40, 32, 32), 40_960),
    "pyhyp_m6_9blocks.xyz": (9, (33, 9, 41), 172_077),
    "hh_naca0012_12blocks.xyz": (12, (13, 17, 17), 45_084),
    "cfl3d_sduct.bin": (2, (25, 31, 21), 96_348),
    "aither_uniform_10blocks.xyz": (10, (11, 5, 5), 2_750),
    "nasa_vspt_turbine.xyz.gz": (2, (257, 101, 33), 2_296_538),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL_SHAPES)
def test_real_grid_is_read_whole_and_written_back_alike(real_grids, tmp_path, name):
    grid = read_plot3d(real_grids / name)
    assert (len(grid.blocks), grid.shapes[0], grid.n_nodes) == REAL_SHAPES[name]
    assert grid.dialect.layout == "whole"
    write_plot3d(tmp_path / "grid", grid)
    if grid.dialect.encoding == "ascii":
        assert_same_grid(read_plot3d(tmp_path / "grid"), grid)
        return
    written, original = (tmp_path / "grid").read_bytes(), (real_grids / name).read_bytes()
    if grid.dialect.compression == "gzip":
        written, original = gzip.decompress(written), gzip.decompress(original)
    assert written == original


def test_one_grid_in_three_real_dialects_is_the_same(real_grids):
    text, records, raw = (read_plot3d(real_grids / f"multi-{name}.xyz") for name in ("ascii", "bin", "bin-C"))
    assert_same_grid(records, raw)
    np.testing.assert_allclose(text.to_vector(), raw.to_vector(), atol=1e-6)
