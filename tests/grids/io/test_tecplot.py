"""Grids for Tecplot, read back by VTK's reader and number by number."""

import re

import numpy as np
import pytest
from grid_cases import smooth_grid

from bspline_mdao import InputError, write_grid
from bspline_mdao.files import write_tecplot
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.cell_fields import cell_fields


def numbers(path):
    """Names of the variables, and the numbers of every zone."""
    text = path.read_text()
    names = re.findall(r'"([^"]*)"', next(line for line in text.splitlines() if line.startswith("VARIABLES")))
    zones = []
    for zone in text.split("ZONE ")[1:]:
        _, *rest = zone.split("DATAPACKING=BLOCK", 1)[1].split("\n")
        zones.append(np.array(" ".join(rest).split(), dtype=float))
    return names, zones


def test_a_grid_and_its_fields_come_back_to_the_last_bit(tmp_path):
    grid = smooth_grid(((4, 5, 6), (3, 2, 7)), has_iblank=True)
    random = np.random.default_rng(3)
    speed = [random.random((*shape, 3)) for shape in grid.shapes]
    quality = [random.random(tuple(n - 1 for n in shape)) for shape in grid.shapes]
    write_tecplot(tmp_path / "out.dat", grid, {"speed": speed}, {"speed_x": quality})
    names, zones = numbers(tmp_path / "out.dat")
    assert names == ["x", "y", "z", "speed_x", "speed_y", "speed_z", "iblank", "speed_x of cells"]
    for block, v, q, zone in zip(grid.blocks, speed, quality, zones):
        parts = [*np.moveaxis(block.nodes, -1, 0), *np.moveaxis(v, -1, 0), block.iblank, q]
        np.testing.assert_array_equal(zone, np.concatenate([part.ravel(order="F") for part in parts]))


def test_the_reader_of_vtk_finds_nodes_and_cell_fields(tmp_path):
    pyvista = pytest.importorskip("pyvista", reason="PyVista is not installed")
    grid = onera_m6_grid((7, 6, 5))
    write_grid(tmp_path / "wing.dat", grid)
    read = pyvista.get_reader(str(tmp_path / "wing.dat")).read()
    fields = cell_fields(grid)
    assert read.n_blocks == len(grid.blocks)
    assert list(read.keys()) == [block.name for block in grid.blocks]
    for number, block in enumerate(grid.blocks):
        points = block.nodes.transpose(2, 1, 0, 3).reshape(-1, 3)
        np.testing.assert_allclose(read[number].points, points, rtol=1e-6, atol=1e-6)  # it reads 4-byte reals
        assert read[number].dimensions == block.shape
        for name, arrays in fields.items():
            expected = np.nan_to_num(arrays[number].astype(float), nan=-1.0).ravel(order="F")
            np.testing.assert_allclose(read[number].cell_data[name], expected, rtol=1e-6, atol=1e-6)


def test_names_of_patches_go_with_the_file(tmp_path):
    write_grid(tmp_path / "wing.dat", onera_m6_grid((7, 6, 5)))
    assert 'DATASETAUXDATA patch_1 = "wing_upper"' in (tmp_path / "wing.dat").read_text()


def test_no_line_is_longer_than_tecplot_reads(tmp_path):
    write_grid(tmp_path / "wing.dat", onera_m6_grid((7, 6, 5)))
    assert max(map(len, (tmp_path / "wing.dat").read_text().splitlines())) < 4000


def test_other_names_are_refused_with_the_list(tmp_path):
    with pytest.raises(InputError, match=r"no '\.szplt' files are written; name it \.vtm \(ParaView\), \.dat"):
        write_grid(tmp_path / "wing.szplt", onera_m6_grid((7, 6, 5)))
    with pytest.raises(InputError, match="does not fit"):
        write_tecplot(tmp_path / "out.dat", smooth_grid(), {"a": [np.zeros((2, 2, 2))] * 2})
    assert not list(tmp_path.iterdir())
