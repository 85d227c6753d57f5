"""CGNS files in ADF give what the same tree gives in HDF5, and one line where they are damaged."""

import h5py
import numpy as np
import pytest
from adf_cases import AdfWriter, as_adf
from fuzz_cases import N_MUTATIONS
from topology_cases import two_block_plate

from bspline_mdao import fit_grid, read_grid, write_grid
from bspline_mdao.errors import InputError
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.io.adf import copied_cgns

KINDS = pytest.mark.parametrize(
    "options", [{}, {"order": ">"}, {"version": "B"}, {"version": "B", "order": ">", "n_pieces": 3}, {"n_pieces": 4}]
)


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A grid with patches and interfaces, in HDF5."""
    path = tmp_path_factory.mktemp("adf") / "wing.cgns"
    write_grid(path, onera_m6_grid((5, 6, 5)))
    return path


@pytest.mark.slow
@KINDS
def test_a_grid_in_adf_is_that_in_hdf5(stored, tmp_path, options):
    (tmp_path / "old.cgns").write_bytes(as_adf(stored, **options))
    found, expected = read_grid(tmp_path / "old.cgns"), read_grid(stored)
    assert str(found.dialect) == "CGNS (ADF)"
    assert [block.name for block in found.blocks] == [block.name for block in expected.blocks]
    for mine, other in zip(found.blocks, expected.blocks):
        np.testing.assert_array_equal(mine.nodes, other.nodes)
    assert found.patches == expected.patches
    assert found.connections == expected.connections


@pytest.mark.slow
@KINDS
def test_a_copy_holds_every_node_of_the_file(stored, tmp_path, options):
    (tmp_path / "old.cgns").write_bytes(as_adf(stored, **options))
    copied_cgns(tmp_path / "old.cgns", tmp_path / "new.cgns")
    with h5py.File(stored, "r") as expected, h5py.File(tmp_path / "new.cgns", "r") as found:
        places = []
        expected.visit(places.append)
        assert sorted(places) == sorted(place for place in _places(found))
        for place in places:
            if isinstance(expected[place], h5py.Dataset):
                assert found[place].dtype == expected[place].dtype
                np.testing.assert_array_equal(found[place][()], expected[place][()])
            else:
                assert {n: str(v) for n, v in found[place].attrs.items()} == {
                    n: str(v) for n, v in expected[place].attrs.items()
                }


def _places(file):
    found = []
    file.visit(found.append)
    return found


@pytest.mark.slow
def test_a_moved_grid_is_written_back_with_all_that_its_file_held(stored, tmp_path):
    (tmp_path / "old.cgns").write_bytes(as_adf(stored))
    before = (tmp_path / "old.cgns").read_bytes()
    grid = read_grid(tmp_path / "old.cgns")
    moved = grid.with_vector(1.1 * grid.to_vector())
    write_grid(tmp_path / "moved.cgns", moved)
    again = read_grid(tmp_path / "moved.cgns")
    assert str(again.dialect) == "CGNS (HDF5)"
    np.testing.assert_array_equal(again.to_vector(), moved.to_vector())
    assert again.patches == grid.patches
    assert (tmp_path / "old.cgns").read_bytes() == before
    assert fit_grid(grid).n_nodes == len(grid.to_vector()) // 3


def test_links_within_a_file_are_followed_and_those_to_others_named(tmp_path):
    def linked(text):
        writer = AdfWriter()
        x = writer.node("CoordinateX", "DataArray_t", "R8", np.arange(3.0), [])
        first = writer.node("First", "UserDefinedData_t", "MT", None, [("CoordinateX", x)])
        second = writer.node("Second", "", "LK", np.frombuffer(text.encode(), np.int8), [])
        return writer.finished(writer.node("ADF MotherNode", "", "MT", None, [("First", first), ("Second", second)]))

    (tmp_path / "inner.cgns").write_bytes(linked(">/First"))
    copied_cgns(tmp_path / "inner.cgns", tmp_path / "copy.cgns")
    with h5py.File(tmp_path / "copy.cgns", "r") as file:
        assert file["Second/ link/CoordinateX/ data"][()].tolist() == [0.0, 1.0, 2.0]
    (tmp_path / "outer.cgns").write_bytes(linked("other.cgns>/First"))
    with pytest.raises(InputError, match=r"node /Second is a link to the file other\.cgns; put both into one file"):
        read_grid(tmp_path / "outer.cgns")


def test_nodes_that_are_their_own_children_and_pointers_beyond_the_end_are_refused(tmp_path):
    writer = AdfWriter()
    unknown = 123456
    root = writer.node("ADF MotherNode", "", "MT", None, [("Base", unknown)])
    child = writer.node("Base", "CGNSBase_t", "MT", None, [("Base", root)])
    data = writer.finished(root).replace(writer.pointer(unknown), writer.pointer(child))
    (tmp_path / "circle.cgns").write_bytes(data)
    with pytest.raises(InputError, match=r"damaged or incomplete CGNS/ADF file \(the node at byte \d+ has two parents"):
        read_grid(tmp_path / "circle.cgns")
    (tmp_path / "short.cgns").write_bytes(data[:300])
    with pytest.raises(InputError, match="damaged or incomplete CGNS/ADF file"):
        read_grid(tmp_path / "short.cgns")
    other = data.replace(b"Version A", b"Version Z")
    (tmp_path / "other.cgns").write_bytes(other)
    with pytest.raises(InputError, match="convert it with 'adf2hdf'"):
        read_grid(tmp_path / "other.cgns")


def test_a_node_with_fewer_bytes_than_its_shape_and_one_with_too_many_dimensions_are_named(tmp_path):
    writer = AdfWriter()
    x = writer.node("CoordinateX", "DataArray_t", "R8", np.arange(3.0), [])
    data = writer.finished(writer.node("ADF MotherNode", "", "MT", None, [("CoordinateX", x)]))
    shape = b"R8".ljust(32) + b"0100000003"
    assert data.count(shape) == 1
    for wrong, words in (
        (b"0100000005", r"node 'CoordinateX' of shape \(5,\) has 24 bytes"),
        (b"0D00000003", "13 dimensions of the node at byte"),
        (b"xx00000003", "'xx' is no number"),
    ):
        (tmp_path / "wrong.cgns").write_bytes(data.replace(shape, shape[:32] + wrong))
        with pytest.raises(InputError, match=words) as error:
            copied_cgns(tmp_path / "wrong.cgns", tmp_path / "copy.cgns")
        assert "\n" not in str(error.value)


@pytest.mark.slow
@pytest.mark.parametrize("version", ["A", "B"])
def test_damaged_files_end_in_one_line_or_hold_the_bytes_that_the_file_holds(tmp_path, version):
    write_grid(tmp_path / "plate.cgns", two_block_plate())
    good, random = as_adf(tmp_path / "plate.cgns", version=version), np.random.default_rng(8)
    whole = read_grid(tmp_path / "plate.cgns").to_vector()
    path, lines = tmp_path / "mutant.cgns", []
    tags = [at for tag in (b"NoDe", b"SNTb", b"DaTa", b"AdF4") for at in _found(good, tag)]
    for number in range(N_MUTATIONS):
        mutant = bytearray(good)
        if number % 4 == 0:
            mutant = mutant[: random.integers(200, len(good))]
        else:
            for at in random.choice(tags, 2) + random.integers(0, 240, 2):
                if at < len(mutant):
                    mutant[at] = (
                        random.integers(0, 256) if number % 4 == 1 else ord(random.choice(list("0123456789AF ")))
                    )
        path.write_bytes(mutant)
        try:
            found = read_grid(path).to_vector()
        except InputError as error:
            lines.append(str(error))
        else:
            assert np.isfinite(found).all()
            assert len(found) <= len(whole)
    assert len(lines) > 0.25 * N_MUTATIONS
    assert not any("\n" in line for line in lines)


def _found(data: bytes, tag: bytes) -> list[int]:
    places, at = [], data.find(tag)
    while at >= 0:
        places.append(at)
        at = data.find(tag, at + 1)
    return places


@pytest.mark.slow
def test_a_real_file_has_the_nodes_of_its_plot3d_twin(real_grids):
    folder = real_grids.parent / "strangers"
    if not folder.is_dir():
        pytest.skip("no strangers")
    old, twin = read_grid(folder / "tmr_nak_141_adf.cgns"), read_grid(folder / "tmr_nak_a_fine_unified_141.p3dfmt")
    assert old.shapes == twin.shapes
    np.testing.assert_allclose(old.to_vector(), twin.to_vector(), rtol=0, atol=1e-7 * np.abs(twin.to_vector()).max())
    assert old.patches is not None
    assert {patch.kind for patch in old.patches} >= {"wall", "symmetry", "farfield"}
