"""Grids of blocks that one lattice moves: from the file, by commands and in Python."""

import re
from dataclasses import replace

import h5py
import numpy as np
import pytest
from overset_cases import overset_grid
from test_cli import fails_as_expected, numbers

from bspline_mdao import read_grid, write_grid
from bspline_mdao.generators import ball_grid
from bspline_mdao.grids.io import cgns
from bspline_mdao.grids.io.plot3d import write_plot3d
from bspline_mdao.grids.io.plot3d_dialect import Plot3dDialect
from bspline_mdao.grids.topology import detection
from bspline_mdao.meshes import LatticeSettings, MeshModel, fit_mesh, open_mesh_file
from bspline_mdao.studio.cli.main import run


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_grid("ball.cgns", ball_grid((5, 6, 5, 4), far=3.0, octant=True))
    return tmp_path


def stored(path) -> dict[str, object]:
    """All that an HDF5 file has but for coordinates."""
    found: dict[str, object] = {}

    def note(name, node):
        found[name] = dict(node.attrs).keys()
        if isinstance(node, h5py.Dataset) and "GridCoordinates" not in name:
            found[name] = node[()].tobytes()

    with h5py.File(path) as file:
        file.visititems(note)
    return found


def test_the_command_and_python_write_the_same_nodes_and_keep_all_else_of_the_file(workplace):
    assert run(["fit", "ball.cgns", "--lattice", "--spacing", "0.5", "-o", "ball.h5"]) == 0
    assert run(["move", "ball.h5", "--deform", "stretch=1.2", "-o", "moved.cgns", "--json", "move.json"]) == 0
    assert numbers("move.json")["n_inverted"] == {"before": 0, "after": 0}
    assert stored("ball.cgns") == stored("moved.cgns")
    model, again = MeshModel.load("ball.h5"), fit_mesh("ball.cgns", settings=LatticeSettings(spacing=0.5))
    assert again.checksum == model.checksum
    before, after = (read_grid(name).to_vector().reshape(-1, 3) for name in ("ball.cgns", "moved.cgns"))
    assert np.abs(after - before).max() > 0.01
    asked = np.zeros_like(model.mesh.points)
    asked[model.mesh.numbers] = after
    moved = model.mover.move(model.control_points, asked[model.wall_rows])
    nodes = model.node_map.at(moved.points).nodes
    assert np.abs(model.mesh.nodes_of_file(nodes) - after).max() < 1e-13
    open_mesh_file(model).write("again.cgns", nodes)
    np.testing.assert_array_equal(read_grid("again.cgns").to_vector(), model.mesh.nodes_of_file(nodes).ravel())


def test_the_unit_of_a_grid_is_that_of_its_lattice_and_its_messages_speak_of_no_mesh(workplace, capsys):
    assert run(["fit", "ball.cgns", "--lattice", "--spacing", "0.5", "--units", "in", "-o", "ball.h5"]) == 0
    assert re.search(r"spans [\d.]+ in wide", " ".join(capsys.readouterr().out.split()))
    fails_as_expected(
        [*["move", "ball.h5", "--deform", "stretch=1.1", "--mover", "elasticity", "-o", "m.cgns"]],
        capsys,
        "is moved by the lattice around it, and has no control mesh; leave out --mover",
    )


def test_the_wrong_output_file_or_a_changed_grid_is_refused_in_one_line(workplace, capsys):
    assert run(["fit", "ball.cgns", "--lattice", "--spacing", "0.5", "-o", "ball.h5"]) == 0
    move = ["move", "ball.h5", "--deform", "stretch=1.1", "-o"]
    fails_as_expected([*move, "moved.xyz"], capsys, "written as it is read, as CGNS")
    grid = read_grid("ball.cgns")
    write_grid("ball.cgns", grid.with_vector(1.01 * grid.to_vector()))
    fails_as_expected([*move, "moved.cgns"], capsys, "has changed since")
    fails_as_expected(["fit", "mesh.su2", "--no-lattice", "-o", "a.h5"], capsys, "leave out --no-lattice")
    fails_as_expected(["fit", "@flat_plate", "--lattice", "-o", "a.h5"], capsys, "--lattice")


def test_a_grid_without_walls_is_refused_with_what_to_do(workplace, capsys):
    (workplace / "none.toml").write_text('[kinds]\n"*" = "farfield"\n')
    fit = ["fit", "ball.cgns", "--lattice", "--patches", "none.toml", "-o", "ball.h5"]
    fails_as_expected(fit, capsys, "no patch is a wall")


def test_component_grids_that_overlap_move_by_a_lattice_and_keep_their_blanking(workplace, capsys):
    grid = overset_grid(4, 9)
    iblank = [np.ones(block.shape, dtype=np.int32) for block in grid.blocks]
    for each in iblank[:12]:
        each[:, :, -1] = -13
    blocks = tuple(replace(block, iblank=each) for block, each in zip(grid.blocks, iblank))
    write_plot3d("balls.xyz", replace(grid, blocks=blocks), Plot3dDialect("fortran", ">", has_iblank=True))
    faces = {"one": range(6), "two": range(6, 12)}
    lines = [
        f'[[patch]]\nname = "{name}"\nkind = "wall"\nfaces = [{", ".join(_face(n) for n in numbers)}]\n'
        for name, numbers in faces.items()
    ]
    (workplace / "patches.toml").write_text("".join(lines))
    assert run(["inspect", "balls.xyz", "--patches", "patches.toml", "--json", "inspect.json"]) == 0
    assert "12 faces blanked as interpolated" in numbers("inspect.json")["overlap"]
    fit = ["fit", "balls.xyz", "--patches", "patches.toml", "--spacing", "0.5", "-o", "balls.h5"]
    assert run(fit) == 0
    assert "one lattice moves them" in capsys.readouterr().out
    move = ["move", "balls.h5", "--design", "one", "--deform", "translate=0/0.1/0", "-o"]
    assert run([*move, "moved.xyz", "--json", "move.json"]) == 0
    found = numbers("move.json")
    assert found["overlap"]["n_donors"] == found["overlap"]["n_fringe"] > 50
    assert found["overlap"]["largest"] < 0.1
    before, after = read_grid("balls.xyz"), read_grid("moved.xyz")
    for one, other, blanks in zip(before.blocks, after.blocks, iblank):
        np.testing.assert_array_equal(other.iblank, blanks)
        assert one.shape == other.shape
    wall = after.blocks[0].nodes[:, :, 0] - before.blocks[0].nodes[:, :, 0]
    assert np.abs(wall - [0.0, 0.1, 0.0]).max() < 1e-13
    assert (workplace / "balls.xyz").stat().st_size == (workplace / "moved.xyz").stat().st_size


def _face(number: int) -> str:
    return f'{{ block = {number + 1}, face = "kmin" }}'


def test_a_fit_of_component_grids_reads_the_file_and_finds_its_topology_once(workplace, monkeypatch):
    write_grid("overset.cgns", overset_grid(4, 9))
    counts = {"read_cgns": 0, "_shells": 0}
    for module, name in ((cgns, "read_cgns"), (detection, "_shells")):
        function = getattr(module, name)

        def counted(*arguments, name=name, function=function):
            counts[name] += 1
            return function(*arguments)

        monkeypatch.setattr(module, name, counted)
    assert run(["fit", "overset.cgns", "--spacing", "0.5", "-o", "overset.h5"]) == 0
    assert counts == {"read_cgns": 1, "_shells": 1}
