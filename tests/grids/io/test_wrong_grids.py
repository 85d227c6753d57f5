"""What users get wrong with grids, their files and fitted models: one line says what, where and what to do."""

import gzip
import json
from codecs import BOM_UTF8
from dataclasses import replace
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import pytest
from component_cases import two_blocks

from bspline_mdao import FittedModel, Grid, InputError, find_topology, fit_grid, read_grid, write_grid
from bspline_mdao.core.model.model_file import VERSION, checksum_of
from bspline_mdao.files import write_vtk
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.io.formats import MODEL_FORMAT
from bspline_mdao.grids.io.plot3d import write_plot3d
from bspline_mdao.grids.io.plot3d_dialect import Plot3dDialect
from bspline_mdao.grids.topology.grid import Block, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import FixedInterior, LinearElasticity, Transfinite, moving_grid, moving_mesh
from bspline_mdao.studio.cli.main import run

CUBE = np.stack(np.meshgrid(*map(np.arange, (3.0, 4.0, 5.0)), indexing="ij"), axis=-1)
WALL = Patch("wall", "wall", (Window.whole(0, (7, 8, 6)).face(2),))


@cache
def model():
    grid = two_blocks()
    return fit_grid(Grid(grid.blocks, (WALL,)), n_control=(5, 5, 5), order=4)


def with_nan(points):
    points = points.copy()
    points[16, 1] = np.nan
    return points


CALLS = {
    "no blocks": (lambda: Grid(()), "grid: has no blocks; give one or more"),
    "arrays": (lambda: Grid((CUBE,)), "one of the blocks is of type ndarray; give Block objects"),
    "no patch": (lambda: Grid((Block(CUBE, "a"),), ("wall",)), "one of the patches is of type str; give Patch objects"),
    "no node": (lambda: Block(np.zeros((3, 0, 5, 3)), "b7"), r"b7: nodes of shape \(3, 0, 5, 3\); give shape"),
    "two components": (lambda: Block(CUBE[..., :2], "b7"), r"b7: nodes of shape \(3, 4, 5, 2\); .* z = 0 where"),
    "plane": (lambda: Block(CUBE[:, :, 0], "b7"), r"b7: nodes of shape \(3, 4, 3\); give shape \(ni, nj, nk, 3\)"),
    "number": (lambda: Block(1.0, "b7"), "b7: nodes of shape"),
    "nothing": (lambda: Block(None, "b7"), "b7: nodes"),
    "ragged": (lambda: Block([[1.0], [1.0, 2.0]], "b7"), "b7: nodes: no array of numbers"),
    "words": (lambda: Block("nodes", "b7"), "b7: nodes: no array of numbers"),
    "blanking": (
        lambda: Block(CUBE, "b7", np.ones((3, 4, 4))),
        r"b7: IBLANK of shape \(3, 4, 4\); give shape \(3, 4, 5\)",
    ),
    "kind": (lambda: Patch("wing", "wal", ()), "patch wing: kind 'wal' is not known; give one of wall, symmetry"),
    "short vector": (lambda: Grid((Block(CUBE, "a"),)).with_vector([1.0, 2.0]), r"shape \(2,\) does not fit 60 nodes"),
    "nan": (lambda: model().regenerate(with_nan(model().control_points)), "control points: number 17 of .* not finite"),
    "points": (lambda: model().regenerate([[0.0, 0.0, 0.0]]), r"control points of shape \(1, 3\); give shape"),
    "residual": (lambda: replace(model(), residual=with_nan(model().residual)), "residual: number 17 of .* not finite"),
    "few residuals": (lambda: replace(model(), residual=[[0.0] * 3]), r"residual of shape \(1, 3\); give shape \(768"),
    "fitted": (lambda: replace(model(), control_points=with_nan(model().control_points)), "control points: number 17"),
    "topology of a name": (lambda: find_topology("a.xyz"), r"the grid is of type str; read one with read_grid\(path\)"),
    "fit of an array": (lambda: fit_grid(CUBE), "the grid is of type ndarray; read one"),
    "fit of complex nodes": (lambda: fit_grid(Grid((Block(CUBE + 0j, "a"),))), "grid: has complex nodes; give real"),
    "writing an array": (lambda: write_grid("a.xyz", CUBE), "the grid is of type ndarray"),
    "writing an array for ParaView": (lambda: write_vtk("a.vtm", CUBE), "the grid is of type ndarray"),
    "mesh of a grid": (
        lambda: moving_mesh(two_blocks()),
        "the model of a moving mesh is of type Grid; make it with fit",
    ),
    "nodes of a moving grid": (
        lambda: moving_grid(model().topology, two_blocks().to_vector()),
        r"moving grid: nodes of shape \(2304,\); give shape \(768, 3\)",
    ),
    "surface of a grid": (lambda: SurfaceGrid.of(two_blocks()), "the model of a surface is of type Grid; make it"),
    "factor in words": (lambda: model().member("2"), "factor '2' for a family member; give a positive number"),
    "no factor": (lambda: model().member(None), "factor None for a family member"),
    "factors": (lambda: model().member([2, 2, 2]), r"factor \[2, 2, 2\] for a family member"),
    "no number": (lambda: model().member(True), "factor True for a family member"),
    "any memory": (lambda: model().member(1e9), r"factor 1e\+09 makes \d.\de\+29 nodes, beyond memory; lower it"),
    "quality of a point": (
        lambda: GridQuality.of_baseline(Grid((Block(CUBE, "a"), Block(np.ones((2, 3, 4, 3)), "b")))),
        "grid: all nodes of block 2 are at one point; leave it out",
    ),
}


@pytest.mark.parametrize("name", CALLS)
def test_wrong_input_is_named_in_one_line(name):
    call, message = CALLS[name]
    with pytest.raises(InputError, match=message) as error:
        call()
    assert "\n" not in str(error.value)


def test_lists_are_taken_for_arrays():
    block = Block(CUBE.tolist(), "a", np.ones((3, 4, 5)).tolist())
    assert (block.nodes.dtype, block.iblank.dtype) == (np.float64, np.int32)
    np.testing.assert_array_equal(block.nodes, CUBE)
    grid = Grid([block])
    assert grid.blocks == (block,)
    np.testing.assert_array_equal(grid.with_vector(grid.to_vector().tolist()).to_vector(), grid.to_vector())
    points = model().control_points
    np.testing.assert_array_equal(
        model().regenerate(points.tolist()).to_vector(), model().regenerate(points).to_vector()
    )


def test_movers_take_lists():
    mesh = moving_mesh(model())
    surface = mesh.points[mesh.surface_ids] + [0.0, 0.0, 1e-3]
    moved = FixedInterior(mesh).move(mesh.points.tolist(), surface.tolist())
    np.testing.assert_array_equal(moved.points, FixedInterior(mesh).move(mesh.points, surface).points)


def test_arrays_are_kept_as_they_are():
    assert Block(CUBE, "a").nodes is CUBE
    assert np.iscomplexobj(Block(CUBE + 1e-30j, "a").nodes)


@pytest.mark.parametrize("n_increments", [0, -1, True, False, 2.0, 0.5, "3", None, [1]])
@pytest.mark.parametrize("kind", [LinearElasticity, Transfinite])
def test_increments_are_a_whole_number(kind, n_increments):
    mesh = moving_mesh(model())
    with pytest.raises(InputError, match="increments"):
        kind(mesh, n_increments=n_increments).move(mesh.points, mesh.points[mesh.surface_ids])


def test_a_block_that_is_given_twice_is_reported_and_not_fitted(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    twice = Grid((Block(CUBE, "a"), Block(CUBE, "b")))
    assert any("is a block given twice" in warning for warning in find_topology(twice).warnings)
    write_grid("twice.xyz", twice)
    for arguments in (["inspect", "twice.xyz"], ["quality", "twice.xyz"]):
        assert run(arguments) == 0
        assert "block 1 (1, 1-4, 1-5) and block 2 (1, 1-4, 1-5) coincide" in capsys.readouterr().err
    assert run(["fit", "twice.xyz", "-o", "m.h5"]) == 2
    assert "twice.xyz: block 2 repeats block 1" in capsys.readouterr().err
    assert not Path("m.h5").exists()
    with pytest.raises(InputError, match="block 2 repeats block 1; leave one of them out"):
        fit_grid(twice)


@pytest.mark.parametrize("name", ["x.foo", "x.vtk", "x.su2", "x.dat.gz", "x.CSV"])
def test_a_suffix_of_no_format_is_refused_with_those_that_are(tmp_path, name):
    with pytest.raises(
        InputError,
        match=r"no '\.[\w.]+' files are written; name it \.vtm \(ParaView\), \.dat \(Tecplot\), \.cgns, .*\.xyz",
    ):
        write_grid(tmp_path / name, two_blocks())
    assert not list(tmp_path.iterdir())


def test_a_plot3d_grid_keeps_the_suffix_that_it_was_read_from(tmp_path):
    write_plot3d(tmp_path / "in.dat", two_blocks(), Plot3dDialect("fortran", ">"))
    write_grid(tmp_path / "out.dat", read_grid(tmp_path / "in.dat"))
    assert (tmp_path / "out.dat").read_bytes() == (tmp_path / "in.dat").read_bytes()
    with pytest.raises(InputError, match=r"'\.foo'"):
        write_grid(tmp_path / "out.foo", read_grid(tmp_path / "in.dat"))


def test_the_commands_refuse_such_names_before_they_work(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    model().save("m.h5")
    for arguments in (
        ["refine", "m.h5", "--factor", "1", "-o", "x.foo"],
        ["move", "m.h5", "--deform", "twist=1deg", "-o", "x.su2"],
        ["fit", "@flat_plate:5x5x5", "-o", "x.xyz"],
    ):
        assert run(arguments) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert "name it" in error
    assert [path.name for path in Path().iterdir()] == ["m.h5"]


def test_a_byte_order_mark_is_passed_over(tmp_path):
    write_grid(tmp_path / "a.fmt", two_blocks())
    (tmp_path / "b.fmt").write_bytes(BOM_UTF8 + (tmp_path / "a.fmt").read_bytes())
    found = read_grid(tmp_path / "b.fmt")
    assert found.dialect.encoding == "ascii"
    np.testing.assert_array_equal(found.to_vector(), read_grid(tmp_path / "a.fmt").to_vector())


@pytest.mark.parametrize("trailing", [b"\0" * 512, b"some more"])
def test_bytes_after_compressed_data_are_ignored_and_reported(tmp_path, trailing):
    write_grid(tmp_path / "a.xyz", two_blocks())
    plain = (tmp_path / "a.xyz").read_bytes()
    members = gzip.compress(plain[:1000]) + gzip.compress(plain[1000:])
    (tmp_path / "b.xyz.gz").write_bytes(members)
    assert read_grid(tmp_path / "b.xyz.gz").dialect.ignored == ()
    (tmp_path / "b.xyz.gz").write_bytes(members + trailing)
    found = read_grid(tmp_path / "b.xyz.gz")
    np.testing.assert_array_equal(found.to_vector(), two_blocks().to_vector())
    (note,) = find_topology(found).warnings
    assert f"the {len(trailing)} bytes after the compressed data are ignored" in note
    assert str(tmp_path / "b.xyz.gz") in note


def test_a_compressed_file_that_is_cut_is_refused(tmp_path):
    write_grid(tmp_path / "a.xyz.gz", two_blocks())
    (tmp_path / "b.xyz.gz").write_bytes((tmp_path / "a.xyz.gz").read_bytes()[:-9])
    with pytest.raises(InputError, match="damaged gzip file"):
        read_grid(tmp_path / "b.xyz.gz")


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "sound.h5"
    model().save(path)
    return path


def forge(path, change):
    """Write a model of which something was changed, with a checksum that fits."""
    arrays = {}
    with h5py.File(path, "r") as file:
        file.visititems(lambda name, item: arrays.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
    document = json.loads(arrays.pop("document").tobytes())
    change(document, arrays)
    text = json.dumps(document).encode()
    forged = path.with_name("forged.h5")
    with h5py.File(forged, "w") as file:
        file.attrs.update(format=MODEL_FORMAT, version=VERSION, checksum=checksum_of(text, arrays))
        file["document"] = np.frombuffer(text, np.uint8)
        for name, array in arrays.items():
            file.create_dataset(name, data=array)
    return forged


def put(*path, value):
    """A change of the document."""

    def change(document, arrays):
        for key in path[:-1]:
            document = document[key]
        document[path[-1]] = value

    return change


def put_array(name, function):
    def change(document, arrays):
        arrays[name] = function(arrays[name].copy())

    return change


def nan_first(array):
    array.flat[0] = np.nan
    return array


FORGERIES = {
    "NaN residual": put_array("residual", nan_first),
    "short residual": put_array("residual", lambda array: array[:-1]),
    "NaN control points": put_array("control_points", nan_first),
    "NaN parameters": put_array("parameters/1", nan_first),
    "far parameters": put_array("parameters/0", lambda array: array + 7.0),
    "other parameters": put_array("parameters/0", lambda array: array[1:]),
    "ids": put_array("control_ids/0", lambda array: array + 1000),
    "knots": put_array("knots/0/1", lambda array: -array),
    "names": put("header", "names", value=["one"]),
    "no name": put("header", "names", value=[1, 2]),
    "shapes": put("topology", "shapes", value=[[7, 8, 6], [9, 8, 7]]),
    "no shapes": put("topology", "shapes", value=[]),
    "segments": put("topology", "segments", 0, "hi", value=[6, 7, 4]),
    "few segments": put("topology", "segments", value=[]),
    "negative": put("topology", "segments", 1, "lo", value=[-1, 0, 0]),
    "half an index": put("topology", "segments", 1, "hi", value=[8.0, 7, 5]),
    "block": put("topology", "interfaces", 0, "a", "block", value=9),
    "orientation": put("topology", "links", 0, "orientation", "perm", value=[0, 0, 1]),
    "turned": put("topology", "links", 0, "orientation", "perm", value=[0, 2, 1]),
    "link": put("topology", "links", 0, "b", value=2),
    "section": put("topology", "links", 0, "a_section", value=[None, None, 3]),
    "patch": put("header", "patches", 0, "windows", 0, "hi", value=[6, 0, 99]),
    "kind": put("header", "patches", 0, "kind", value="wal"),
    "patch name": put("topology", "boundary", 0, "patch", value=4),
    "record": put("report", "record", value="Window"),
}


@pytest.mark.parametrize("name", FORGERIES)
def test_forged_models_are_refused(saved, name):
    forged = forge(saved, FORGERIES[name])
    with pytest.raises(InputError, match=r"forged\.h5: the fitted model is damaged; fit the grid again"):
        FittedModel.load(forged)


def test_a_model_that_nobody_forged_is_read(saved):
    forged = forge(saved, lambda document, arrays: None)
    np.testing.assert_array_equal(FittedModel.load(forged).control_points, model().control_points)
