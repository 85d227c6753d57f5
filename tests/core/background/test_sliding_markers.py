"""Nodes of a mesh without structure that slide on surfaces which are not planes, by the kind of their marker."""

import json
from functools import cache

import numpy as np
import pytest
from mesh_cases import TETRAHEDRA
from riding_cases import su2_text

from bspline_mdao import InputError
from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.files import read_mesh
from bspline_mdao.grids.cells.mixed_cells import MixedMesh
from bspline_mdao.grids.topology.partition import Subdomain
from bspline_mdao.studio.cli.main import run
from bspline_mdao.testing import dot_test

KINDS = {
    **{"blade": "wall", "hub": "sliding", "casing": "sliding", "inlet": "farfield", "outlet": "farfield"},
    **{"low": "other", "high": "other"},
}


def duct(casing=lambda x: 2.0 + 0.0 * x, turn=None):
    """Tetrahedra around a blade between a hub of radius 1 and a casing, in a sector of the annulus between them."""
    x, angle, part = np.linspace(-1.5, 1.5, 13), np.linspace(-0.6, 0.6, 12), np.linspace(0.0, 1.0, 8)
    ids = np.arange(13 * 12 * 8).reshape(13, 12, 8)
    x, angle, part = np.meshgrid(x, angle, part, indexing="ij")
    r = 1.0 + part * (casing(x) - 1.0)
    points = np.stack([x, r * np.sin(angle), r * np.cos(angle)], axis=-1).reshape(-1, 3)
    is_blade = np.zeros((12, 11, 7), dtype=bool)
    is_blade[4:8, 5] = True
    a, b = slice(None, -1), slice(1, None)
    ring = [(a, a), (b, a), (b, b), (a, b)]
    hexahedra = np.stack([ids[i, j, k] for k in (a, b) for i, j in ring], axis=-1)[~is_blade]
    cells = hexahedra[:, TETRAHEDRA].reshape(-1, 4)
    skin = MixedMesh(points, {"tetra": cells}).skin
    index = np.stack(np.unravel_index(skin, ids.shape), axis=-1)
    ends = {"inlet": (0, 0), "outlet": (0, 12), "low": (1, 0), "high": (1, 11), "hub": (2, 0), "casing": (2, 7)}
    on = {name: (index[..., axis] == at).all(axis=1) for name, (axis, at) in ends.items()}
    is_wall = ~np.any(list(on.values()), axis=0)
    used, numbers = np.unique(cells, return_inverse=True)
    place = np.full(len(points), -1)
    place[used] = np.arange(len(used))
    points = points[used] if turn is None else points[used] @ turn.T + [3.0, -2.0, 1.0]
    markers = {"blade": place[skin[is_wall]], **{name: place[skin[rows]] for name, rows in on.items()}}
    return MixedMesh(points, {"tetra": numbers.reshape(cells.shape)}, markers, source="duct")


@cache
def model(kind="sliding"):
    """The duct, whose hub and casing slide, or stay."""
    kinds = {name: kind if of == "sliding" else of for name, of in KINDS.items()}
    return MeshModel.of(duct(), kinds, LatticeSettings(spacing=0.3))


def leaned(model, amount=0.15):
    """Nodes of the blade turned about x by an angle that grows with x and with the radius, and stretched."""
    nodes = model.mesh.points[model.wall_rows]
    x, y, z = nodes.T
    angle = amount * (1.0 + 0.5 * x) * np.hypot(y, z)
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([1.05 * x, c * y + s * z, 1.02 * (c * z - s * y)])


def moved(model, walls):
    return model.node_map.at(model.mover.move(model.control_points, walls).points)


def radii(points, name, mesh):
    return np.hypot(*points[np.unique(mesh.markers[name]), 1:].T)


def test_nodes_stay_on_hub_and_casing_and_slide_there():
    sliding, resting = model(), model("other")
    nodes = moved(sliding, leaned(sliding)).nodes
    for name, radius in (("hub", 1.0), ("casing", 2.0)):
        np.testing.assert_allclose(radii(nodes, name, sliding.mesh), radius, rtol=0.0, atol=1e-13)
        rows = np.unique(sliding.mesh.markers[name])
        assert np.linalg.norm(nodes[rows] - sliding.mesh.points[rows], axis=1).max() > 0.1
    assert not sliding.mesh.quality(nodes).is_inverted.any()
    others = moved(resting, leaned(resting)).nodes  # where hub and casing stay
    assert resting.mesh.quality(others).is_inverted.sum() > 10


def test_walls_go_where_they_are_asked_to_but_for_those_that_slide():
    sliding = model()
    walls, nodes = leaned(sliding), moved(sliding, leaned(sliding)).nodes
    slides = np.isin(sliding.wall_rows, sliding.sliding_nodes.rows)
    np.testing.assert_array_equal(nodes[sliding.wall_rows[~slides]], walls[~slides])
    off = np.linalg.norm(nodes[sliding.wall_rows[slides]] - walls[slides], axis=1)
    assert 0.01 < off.max() < 0.1


def test_at_rest_nothing_moves():
    sliding = model()
    nodes = moved(sliding, sliding.mesh.points[sliding.wall_rows]).nodes
    np.testing.assert_allclose(nodes, sliding.mesh.points, rtol=0.0, atol=1e-14)


def test_nodes_of_other_markers_stay():
    sliding = model()
    nodes = moved(sliding, leaned(sliding)).nodes
    for name in ("inlet", "outlet", "low", "high"):
        rows = np.unique(sliding.mesh.markers[name])
        np.testing.assert_array_equal(nodes[rows], sliding.mesh.points[rows])


def test_derivatives_are_exact():
    sliding, rng = model(), np.random.default_rng(0)
    control = sliding.mover.move(sliding.control_points, leaned(sliding)).points
    control = control + 0.003 * rng.normal(size=control.shape)
    state, step = sliding.node_map.at(control), rng.normal(size=control.shape)
    change = state.jvp(step)
    found = []
    for h in (2e-5, 1e-5):
        ends = (sliding.node_map.at(control + sign * h * step).nodes for sign in (1.0, -1.0))
        found.append(np.subtract(*ends) / (2.0 * h))
    differences = (4.0 * found[1] - found[0]) / 3.0
    assert np.abs(differences - change).max() < 1e-7 * np.abs(change).max()
    shape = control.shape
    error = dot_test(
        lambda d: state.jvp(d.reshape(shape)).ravel(),
        lambda bar: state.vjp(bar.reshape(-1, 3))["control_points"].ravel(),
        control.size,
        state.nodes.size,
    )
    assert error < 1e-13


def test_a_process_has_the_bits_of_its_nodes():
    sliding = model()
    control = sliding.mover.move(sliding.control_points, leaned(sliding)).points
    whole, rng = sliding.node_map.at(control), np.random.default_rng(1)
    step = rng.normal(size=control.shape)
    rows = np.flatnonzero(rng.random(sliding.n_nodes) < 0.3)
    part = sliding.part(Subdomain.of_rows(rows, n_nodes_of_grid=sliding.n_nodes)).node_map.at(control)
    np.testing.assert_allclose(part.nodes, whole.nodes[rows], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(part.jvp(step), whole.jvp(step)[rows], rtol=0.0, atol=1e-12)


def test_a_model_is_the_same_after_a_file(tmp_path):
    sliding = model()
    sliding.save(tmp_path / "duct.h5")
    again = MeshModel.load(tmp_path / "duct.h5")
    np.testing.assert_array_equal(moved(again, leaned(again)).nodes, moved(sliding, leaned(sliding)).nodes)


TURN = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]


@pytest.mark.parametrize(
    ("casing", "turn", "words"),
    [
        (lambda x: 2.0 + 0.0 * x, TURN, "a cylinder of radius 2 about the direction"),
        (lambda x: 2.0 + 0.2 * x, TURN, "a cone of half angle 11.3099 deg"),
        (lambda x: 2.0 + 0.1 * np.sin(x), None, "a surface of revolution about x, of radii 1.9"),
    ],
)
def test_surfaces_are_found_from_the_nodes(casing, turn, words):
    found = MeshModel.of(duct(casing, turn), KINDS, LatticeSettings(spacing=0.3))
    assert words in str(found.slides["casing"].surface)
    walls = found.mesh.points[found.wall_rows] + [0.02, 0.01, -0.015]
    nodes = moved(found, walls).nodes
    assert found.sliding_nodes.off(nodes) < 1e-12


def test_the_commands_say_what_slides_and_how_far_it_is_off(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "duct.su2").write_text(su2_text(duct()))
    (tmp_path / "kinds.toml").write_text("[kinds]\n" + "".join(f'{name} = "{kind}"\n' for name, kind in KINDS.items()))
    assert run(["fit", "duct.su2", "--patches", "kinds.toml", "--spacing", "0.3", "-o", "duct.h5"]) == 0
    assert "nodes of casing slide on a cylinder of radius 2 about x" in " ".join(capsys.readouterr().out.split())
    words = "rotate=5deg@hinge(0,0,0 -> 1,0,0),patches=blade"
    assert run(["move", "duct.h5", "--deform", words, "-o", "moved.su2", "--json", "m.json"]) == 0
    assert "nodes that slide leave their surfaces by" in " ".join(capsys.readouterr().out.split())
    assert 0.0 <= json.loads((tmp_path / "m.json").read_text())["sliding_off"] < 1e-12
    nodes = read_mesh(tmp_path / "moved.su2").mesh.points
    np.testing.assert_allclose(radii(nodes, "casing", duct()), 2.0, rtol=0.0, atol=1e-12)


def test_a_marker_that_is_on_no_surface_is_named():
    mesh = duct()
    bumped = MixedMesh(
        mesh.points + 0.05 * np.sin(7.0 * mesh.points[:, [1]]) * [0.0, 0.0, 1.0],
        mesh.cells,
        mesh.markers,
        source="duct",
    )
    with pytest.raises(
        InputError, match=r"duct: marker 'hub' is to slide, but leaves .*; give the marker another kind"
    ):
        MeshModel.of(bumped, KINDS, LatticeSettings(spacing=0.3)).node_map  # noqa: B018
