"""Faces that belong together are one interface, whatever round-off and small gaps do to single nodes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner
from topology_cases import are_same_partition, box, c_grid, grid_of, labels_of_rows, patch, smooth_box, split

from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.movement.elasticity import LinearElasticity
from bspline_mdao.errors import FitWarning
from bspline_mdao.generators import Spacing, ball_grid, flat_plate_grid, onera_m6_grid
from bspline_mdao.grids.io.patch_guess import draft_patches
from bspline_mdao.grids.io.plot3d import read_plot3d, write_plot3d
from bspline_mdao.grids.io.plot3d_dialect import Plot3dDialect
from bspline_mdao.grids.topology.coincidence import data_round_off, data_unit
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.sharing import node_sharing
from bspline_mdao.grids.topology.shell import Shell
from bspline_mdao.studio.cli.commands import bspline_mdao

GRIDS = {
    "wing": lambda: onera_m6_grid((9, 15, 8), Spacing(off_wall=1e-6)),
    "plate": lambda: flat_plate_grid((8, 13, 9), Spacing(1e-6, 1e-3, 1e-3, 1e-3)),
    "ball": lambda: ball_grid((6, 7, 8, 21), off_wall=1e-6),
    "undeclared wing": lambda: replace(grid_called("wing"), patches=()),
}


@cache
def grid_called(name):
    return GRIDS[name]()


def with_nodes(grid, change):
    """Grid with the nodes of every block changed."""
    return replace(grid, blocks=tuple(replace(block, nodes=change(block.nodes)) for block in grid.blocks))


def noise(shape, seed):
    """Random numbers that make a rounded number differ by up to two units from block to block."""
    return np.random.default_rng(seed).uniform(-0.6, 0.6, shape)


def single(nodes):
    """Nodes as 4-byte reals, each with its own round-off."""
    units = np.spacing(np.abs(nodes).astype(np.float32))
    return (nodes + noise(nodes.shape, nodes.size) * units * (nodes != 0.0)).astype(np.float32).astype(float)


def digits(n):
    """Nodes as numbers of n significant digits, each with its own round-off."""

    def change(nodes):
        exponent = np.floor(np.log10(np.abs(nodes), where=nodes != 0.0, out=np.zeros_like(nodes)))
        units = 10.0 ** (exponent - n + 1)
        rounded = nodes + noise(nodes.shape, nodes.size) * units * (nodes != 0.0)
        return np.reshape([float(f"{x:.{n - 1}e}") for x in rounded.ravel()], nodes.shape)

    return change


def decimals(n):
    """Nodes as numbers of n decimals, each with its own round-off."""

    def change(nodes):
        rounded = nodes + noise(nodes.shape, nodes.size) * 10.0**-n * (nodes != 0.0)
        return np.reshape([float(f"{x:.{n}f}") for x in rounded.ravel()], nodes.shape)

    return change


def gaps(size):
    """Nodes of which one in twenty is displaced."""

    def change(nodes):
        random = np.random.default_rng(nodes.size)
        return nodes + size * random.uniform(size=nodes.shape) * (random.uniform(size=(*nodes.shape[:3], 1)) < 0.05)

    return change


def labels_of(grid):
    topology = find_topology(grid)
    return topology, labels_of_rows(topology, node_sharing(topology))


STORED = {
    "4-byte reals": single,
    **{f"{n} digits": digits(n) for n in (7, 8, 9)},
    **{f"{n} decimals": decimals(n) for n in (7, 8, 9)},
    "gaps": gaps(1e-9),
}


@pytest.mark.slow
@pytest.mark.parametrize("stored", STORED)
@pytest.mark.parametrize("name", GRIDS)
def test_round_off_and_gaps_of_the_size_of_wall_cells_tear_nothing(name, stored):
    exact, labels = labels_of(grid_called(name))
    grid = with_nodes(grid_called(name), STORED[stored])
    there = node_sharing(exact).copies
    points = grid.to_vector().reshape(-1, 3)
    assert np.abs(points[there[:, 0]] - points[there[:, 1]]).max() > 1e-10
    topology, found = labels_of(grid)
    assert topology.interfaces == exact.interfaces
    assert topology.segments == exact.segments
    assert topology.boundary == exact.boundary
    assert topology.near_misses == ()
    assert bool(topology.joined_gaps) == (stored == "gaps")
    assert are_same_partition(found, labels)


@pytest.mark.parametrize("encoding", ["raw", "fortran", "ascii"])
def test_a_viscous_grid_survives_a_file_of_low_precision(tmp_path, encoding):
    grid = with_nodes(grid_called("wing"), decimals(8) if encoding == "ascii" else single)
    write_plot3d(tmp_path / "wing.xyz", grid, Plot3dDialect(encoding=encoding, real_bytes=4))
    read = replace(read_plot3d(tmp_path / "wing.xyz"), patches=grid.patches)
    topology = find_topology(read)
    assert (len(topology.interfaces), len(topology.segments)) == (19, 12)
    assert (topology.near_misses, topology.warnings) == ((), ())


def round_off_of(nodes):
    return data_round_off([Shell.of(nodes)])


def unit_of(nodes):
    return data_unit([Shell.of(nodes)])


def test_precision_is_that_of_the_data():
    nodes = 3.0 * grid_called("wing").blocks[0].nodes
    assert (round_off_of(nodes), unit_of(nodes)) == (np.finfo(float).eps, 0.0)
    assert unit_of(single(nodes)) == 0.0
    for n in (5, 6, 9):
        assert round_off_of(digits(n)(nodes)) == 10.0 ** (1 - n)
        assert unit_of(decimals(n)(nodes)) == 10.0**-n
    regular = box(np.arange(40) * 0.0625, np.arange(30) * 0.2, np.arange(20) * 0.0001)
    assert (round_off_of(regular), unit_of(regular)) == (1e-6, 0.0)


def torn_wing():
    """Wing grid whose blocks outboard of the tip are off by a small part of the cells at the wall."""
    grid = grid_called("wing")
    blocks = list(grid.blocks)
    for number in (7, 10):
        nodes = blocks[number].nodes.copy()
        nodes[3:7, :, 0, 0] += 5.5e-10
        blocks[number] = replace(blocks[number], nodes=nodes)
    return replace(grid, blocks=tuple(blocks))


def test_a_gap_of_a_small_part_of_a_cell_is_joined_and_reported():
    topology = find_topology(torn_wing())
    assert (len(topology.interfaces), len(topology.segments), topology.near_misses) == (19, 12, ())
    assert {(miss.window.block, miss.other.block) for miss in topology.joined_gaps} >= {(1, 7), (4, 10)}
    worst = max(topology.joined_gaps, key=lambda miss: miss.gap / miss.spacing)
    assert worst.gap == pytest.approx(5.5e-10, rel=1e-3)
    assert worst.spacing == pytest.approx(1e-6, rel=0.1)
    (warning,) = topology.warnings
    assert warning.startswith("joined, though not all of their nodes coincide: ")
    assert "by 5.5e-10 m where cells are 1e-06 m" in warning


@pytest.mark.parametrize("size", [1e-3, 0.03, 0.2])
def test_a_single_node_is_joined_within_a_hundredth_of_a_cell_and_reported_beyond(size):
    left, right = (block.copy() for block in split(smooth_box(9, 7, 8), [4], [], []))
    spacing = np.linalg.norm(np.diff(right, axis=2), axis=-1)[0, 3, 3:5].min()
    right[0, 3, 4, 2] += size * spacing
    topology = find_topology(grid_of(left, right))
    (miss,) = topology.joined_gaps or topology.near_misses
    assert miss.gap == pytest.approx(size * spacing)
    assert len(topology.warnings) == 1
    if size < 0.01:
        assert (topology.joined_gaps, len(topology.interfaces), len(topology.segments)) == ((miss,), 1, 2)
        assert miss.window == Window(0, (4, 0, 0), (4, 6, 7))
    else:
        assert (topology.near_misses, len(topology.interfaces)) == ((miss,), 4)
        assert miss.window == Window(0, (4, 2, 3), (4, 4, 5))


def cusp(gap):
    """Two blocks that lie on one plane up to x = 1 and part from there, the first nodes by ``gap`` of the spacing."""
    x, y, z = np.linspace(0.0, 2.0, 21), np.linspace(0.0, 1.0, 6), np.linspace(0.0, 0.5, 7)
    below, above = box(x, y, -z[::-1]), box(x, y, z)
    opening = gap * (z[1] - z[0]) * np.clip(10.0 * (x - 1.0), 0.0, None) ** 3
    below[..., 2] -= 0.5 * opening[:, None, None]
    above[..., 2] += 0.5 * opening[:, None, None]
    return grid_of(below, above)


@pytest.mark.parametrize("gap", [5e-4, 5e-3, 5e-2])
def test_surfaces_that_part_slowly_are_not_joined(gap):
    topology = find_topology(cusp(gap))
    (interface,) = topology.interfaces
    assert interface.a == Window(0, (0, 0, 6), (10, 5, 6))
    assert topology.joined_gaps == ()
    if gap < 0.01:
        (miss,) = topology.near_misses
        assert miss.window.lo[0] == 10
        assert topology.warnings[0].startswith("not joined, though they nearly meet")


def test_a_wake_with_gaps_is_joined_up_to_the_wall_if_that_is_declared():
    nodes = c_grid()
    random = np.random.default_rng(5)
    nodes[:5, 1:, 0, 0] += 3e-3 * 0.01 * random.uniform(size=nodes[:5, 1:, 0, 0].shape) * (random.random((5, 3)) < 0.3)
    wall = Window(0, (5, 0, 0), (21, 3, 0))
    topology = find_topology(grid_of(nodes, patches=[patch("wall", wall)]))
    (interface,) = topology.interfaces
    assert interface.a == Window(0, (0, 0, 0), (5, 3, 0))
    assert len(topology.joined_gaps) == 1


@pytest.mark.parametrize("gap", [1e-3, 5e-3])
def test_a_thin_gap_between_whole_faces_is_not_closed_but_reported(gap):
    left, right = split(smooth_box(9, 5, 6), [4], [], [])
    shift = gap * np.linalg.norm(np.diff(left, axis=2), axis=-1).min()
    topology = find_topology(grid_of(left, right + [0.0, 0.0, shift]))
    assert (topology.interfaces, topology.joined_gaps) == ((), ())
    assert len(topology.near_misses) == 1
    assert "not joined" in topology.warnings[0]


def shared_points(topology, grid):
    """Places of the two nodes of every pair that is one, as bits."""
    points = grid.to_vector().view(np.int64).reshape(-1, 3)
    copies = node_sharing(topology).copies
    return points[copies[:, 0]], points[copies[:, 1]]


@pytest.mark.parametrize("stored", ["4-byte reals", "gaps"])
def test_what_is_joined_has_equal_bits_in_every_grid_that_is_regenerated(stored):
    grid = with_nodes(grid_called("wing"), STORED[stored])
    model = fit_grid(grid, n_control=(6, 6, 5), method="quasi_interpolant")
    moved = model.control_points + 1e-3 * np.sin(7.0 * model.control_points)
    for regenerated in (model.regenerate(), model.regenerate(moved)):
        np.testing.assert_array_equal(*shared_points(model.topology, regenerated))
    assert not np.array_equal(*shared_points(model.topology, grid))
    off = np.abs(model.regenerate().to_vector() - grid.to_vector()).max()
    assert off < (1e-9 if stored == "gaps" else 5e-6) + 1e-14
    assert any(warning.startswith("joined, though") for warning in model.report.warnings) == (stored == "gaps")


def test_a_fit_warns_once_of_faces_that_nearly_meet():
    left, right = split(smooth_box(9, 5, 6), [4], [], [])
    grid = grid_of(left, right + [0.0, 0.0, 1e-4])
    with pytest.warns(FitWarning) as record:
        model = fit_grid(grid, n_control=(4, 4, 4))
    (message,) = [str(warning.message) for warning in record if "nearly meet" in str(warning.message)]
    assert "block 1 (5, 1-5, 1-6) and block 2 (1, 1-5, 1-6), by 0.0001 m" in message
    assert message.endswith(model.report.warnings[0])


@pytest.mark.slow
def test_every_command_tells_of_faces_that_nearly_meet(tmp_path):
    left, right = split(smooth_box(9, 5, 6), [4], [], [])
    wall = patch("wall", Window(0, (0, 0, 0), (4, 4, 0)))
    grid = grid_of(left, right + [0.0, 0.0, 1e-4], patches=[wall])
    write_plot3d(tmp_path / "torn.xyz", grid)
    (tmp_path / "torn.toml").write_text(draft_patches(grid, [wall]))
    for command in (
        "inspect torn.xyz",
        "fit torn.xyz -o torn.h5 --n-control 4x4x4 --patches torn.toml",
        "move torn.h5 --deform translate=0/0.001/0 -o moved.xyz",
        "refine torn.h5 --factor 1.5 -o fine.xyz",
        "quality torn.xyz",
        "quality torn.h5",
    ):
        arguments = [str(tmp_path / word) if "torn." in word or ".xyz" in word else word for word in command.split()]
        result = CliRunner().invoke(bspline_mdao, arguments)
        assert result.exit_code == 0, result.output
        assert result.output.count("not joined, though they nearly meet") == 1


@pytest.mark.slow
def test_a_wing_with_a_gap_at_its_tip_moves_as_one_without():
    moved = []
    for grid in (grid_called("wing"), torn_wing()):
        model = fit_grid(grid, n_control=(6, 6, 5), method="quasi_interpolant")
        mesh = moving_mesh(model)
        surface = parse_deformation("twist=20deg", model, mesh).apply(mesh.points[mesh.surface_ids])
        moved.append(LinearElasticity(mesh, n_increments=2).move(mesh.points, surface))
    assert moved[1].points.shape == moved[0].points.shape
    assert moved[0].report.increments[0].n_tangled == 0
    np.testing.assert_allclose(moved[1].points, moved[0].points, atol=1e-8)
