"""Grids of blocks that one lattice moves: from the file, by commands and in Python."""

import h5py
import numpy as np
import pytest
from test_cli import fails_as_expected, numbers

from bspline_mdao import read_grid, write_grid
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.meshes import LatticeSettings, MeshModel, fit_mesh, open_mesh_file
from bspline_mdao.studio.cli.main import run


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_grid("wing.cgns", onera_m6_grid((7, 7, 5)))
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
    assert run(["fit", "wing.cgns", "--lattice", "--spacing", "0.5", "-o", "wing.h5"]) == 0
    assert run(["move", "wing.h5", "--deform", "twist=5deg", "-o", "moved.cgns", "--json", "move.json"]) == 0
    assert numbers("move.json")["n_inverted"] == {"before": 0, "after": 0}
    assert stored("wing.cgns") == stored("moved.cgns")
    model, again = MeshModel.load("wing.h5"), fit_mesh("wing.cgns", settings=LatticeSettings(spacing=0.5))
    assert again.checksum == model.checksum
    before, after = (read_grid(name).to_vector().reshape(-1, 3) for name in ("wing.cgns", "moved.cgns"))
    assert np.abs(after - before).max() > 0.01
    asked = np.zeros_like(model.mesh.points)
    asked[model.mesh.numbers] = after
    moved = model.mover.move(model.control_points, asked[model.wall_rows])
    nodes = model.node_map.at(moved.points).nodes
    assert np.abs(model.mesh.nodes_of_file(nodes) - after).max() < 1e-13
    open_mesh_file(model).write("again.cgns", nodes)
    np.testing.assert_array_equal(read_grid("again.cgns").to_vector(), model.mesh.nodes_of_file(nodes).ravel())


def test_the_wrong_output_file_or_a_changed_grid_is_refused_in_one_line(workplace, capsys):
    assert run(["fit", "wing.cgns", "--lattice", "--spacing", "0.5", "-o", "wing.h5"]) == 0
    move = ["move", "wing.h5", "--deform", "twist=1deg", "-o"]
    fails_as_expected([*move, "moved.xyz"], capsys, "written as it is read, as CGNS")
    grid = read_grid("wing.cgns")
    write_grid("wing.cgns", grid.with_vector(1.01 * grid.to_vector()))
    fails_as_expected([*move, "moved.cgns"], capsys, "has changed since")
    fails_as_expected(["fit", "@onera_m6", "--lattice", "-o", "a.h5"], capsys, "--lattice")


def test_a_grid_without_walls_is_refused_with_what_to_do(workplace, capsys):
    (workplace / "none.toml").write_text('[kinds]\n"*" = "farfield"\n')
    fit = ["fit", "wing.cgns", "--lattice", "--patches", "none.toml", "-o", "wing.h5"]
    fails_as_expected(fit, capsys, "no patch is a wall")
