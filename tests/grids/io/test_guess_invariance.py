"""Guesses at patches go by the shape of a grid: not by where it is, how it is turned or mirrored, or by its unit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bspline_mdao import find_topology, fit_grid, read_grid
from bspline_mdao.core.generators.canonical import flat_plate_grid, onera_m6_grid
from bspline_mdao.generators import ball_grid, naca_section, section_o_grid
from bspline_mdao.grids.io.grid_frame import GridFrame
from bspline_mdao.grids.io.patch_guess import guess_faces, with_guessed_patches
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.movers import moving_mesh


def extruded(z, far=20.0, taper=0.0):
    """An O-grid about a section through planes at some z, smaller by taper times z."""
    block = section_o_grid(naca_section(0.12), n_around=24, far=far).blocks[0]
    nodes = np.repeat(block.nodes[:, :, :1], len(z), axis=2)
    nodes[..., :2] *= (1.0 - taper * z)[:, None]
    nodes[..., 2] = z
    return Grid((Block(nodes, "section"),), source="section.xyz")


def pipe(stretch, shape=(9, 12, 13)):
    """A quarter of a pipe that narrows and widens along x: i along, j outwards, k around; walls fine or not."""
    along, out, around = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in shape), indexing="ij")
    radius = (1.0 - np.exp(-stretch * out)) / (1.0 - np.exp(-stretch)) * (1.0 + 0.2 * np.cos(7.0 * along))
    angle = 0.5 * np.pi * around
    nodes = np.stack([8.0 * along, (0.1 + radius) * np.cos(angle), (0.1 + radius) * np.sin(angle)], axis=-1)
    return Grid((Block(nodes, "pipe"),), source="pipe.xyz")


def passage(shape=(7, 6, 5), angle=0.3):
    """An annular passage between periodic sides that are curved."""
    i, j, k = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in shape), indexing="ij")
    turn, radius = angle * (j + 0.4 * i**2), 2.0 + k + 0.1 * np.sin(3.0 * i)
    nodes = np.stack([3.0 * i, radius * np.cos(turn), radius * np.sin(turn)], axis=-1)
    return Grid((Block(nodes, "passage"),), source="passage.xyz")


def cascade(shape=(7, 6, 4)):
    """A passage between curved lines, the one above the other."""
    i, j, k = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in shape), indexing="ij")
    nodes = np.stack([3.0 * i, j + 0.5 * np.sin(2.0 * i), 0.2 * k], axis=-1)
    return Grid((Block(nodes, "cascade"),), source="cascade.xyz")


GRIDS = {
    "wing": lambda: onera_m6_grid((9, 13, 9)),
    "plate": lambda: flat_plate_grid((9, 10, 11)),
    "octant": lambda: ball_grid((5, 6, 7, 8), octant=True),
    "section": lambda: extruded(np.linspace(2.0, 3.0, 2)),
    "deep section": lambda: extruded(np.array([0.0, 40.0])),  # nodes are likeliest in one of its planes
    "wide section": lambda: extruded(np.linspace(2.0, 3.0, 4), far=60.0),
    "wing between walls": lambda: extruded(np.linspace(-1.0, 2.0, 7), taper=0.1),
    "pipe": lambda: pipe(0.5),
    "viscous pipe": lambda: pipe(5.0),
    "passage": passage,
    "wedge": lambda: passage((2, 9, 8), angle=0.02),
    "cascade": cascade,
}


def kinds(grid):
    """Kind and certainty of each boundary window."""
    windows = [face.window for face in find_topology(replace(grid, patches=())).boundary]
    return {guess.window: (guess.kind, guess.level) for guess in guess_faces(replace(grid, patches=()), windows)}


def copies(grid, seed):
    """The grid moved, turned, mirrored, scaled, and all of it, by random numbers."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng).as_matrix()
    size = np.ptp(np.concatenate([block.nodes.reshape(-1, 3) for block in grid.blocks]), axis=0).max()
    shift, mirror = size * rng.uniform(-2.0, 2.0, 3), np.diag([1.0, -1.0, 1.0])
    unit = 10.0 ** rng.uniform(-3.0, 3.0)
    quarter = np.eye(3)[[1, 2, 0]]
    maps = {
        "moved": (np.eye(3), shift),
        "axes exchanged": (quarter, 0.0 * shift),
        "turned": (turn, 0.0 * shift),
        "mirrored": (mirror, 0.0 * shift),
        "scaled": (unit * np.eye(3), 0.0 * shift),
        "all": (unit * turn @ mirror, unit * shift),
    }
    for name, (matrix, offset) in maps.items():
        yield name, replace(grid, blocks=tuple(replace(b, nodes=b.nodes @ matrix.T + offset) for b in grid.blocks))


@pytest.mark.parametrize("name", GRIDS)
def test_guesses_are_the_same_wherever_a_grid_is_and_however_it_is_turned(name):
    grid = GRIDS[name]()
    expected = kinds(grid)
    assert expected
    for how, copy in copies(grid, seed=3):
        assert kinds(copy) == expected, how


REAL = (
    "grids/aither_multiblock_cylinder.xyz",
    "grids/aither_rae2822.xyz",
    "grids/aither_uniform_10blocks.xyz",
    "grids/cfl3d_axibump.fmt",
    "grids/cfl3d_cylinder_ogrid.fmt",
    "grids/cfl3d_delta_wing.fmt.gz",
    "grids/cfl3d_ejector_nozzle.p3dfmt",
    "grids/cfl3d_naca0012_cgrid.fmt",
    "grids/cfl3d_rotorstator.fmt",
    "grids/cfl3d_sduct.bin",
    "grids/cgns_5blocks.cgns",
    "grids/cgns_nozzle.cgns",
    "grids/hh_naca0012_12blocks.xyz",
    "grids/hopr_sphere_20blocks.cgns",
    "grids/mach_naca0012.cgns",
    "grids/multi-ascii.xyz",
    "grids/nasa_vspt_turbine.xyz.gz",
    "grids/pyhyp_m6_9blocks.xyz",
    "grids/vtk_bluntfin.bin",
    "strangers/gdtk_sphere3.g",
    "strangers/pyhyp_bwb_9blocks.xyz",
    "strangers/tmr_nak_a_fine_unified_141.p3dfmt",
)
"""Real grids by their folders; strangers lie where the folder of grids does."""


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_guesses_at_grids_of_others_are_the_same_wherever_they_are(real_grids, name):
    path = real_grids.parent / name
    if not path.exists():
        pytest.skip(f"{path} is not there")
    grid = replace(read_grid(path), patches=())
    windows = [face.window for face in find_topology(grid).boundary]
    expected = {guess.window: (guess.kind, guess.level) for guess in guess_faces(grid, windows)}
    several = ("axes exchanged", "all")  # one by one they are done to small grids
    for how, copy in [(how, copy) for how, copy in copies(grid, seed=4) if how in several]:
        found = {guess.window: (guess.kind, guess.level) for guess in guess_faces(copy, windows)}
        assert found == expected, how


def in_planes(grid, values):
    """Kinds and certainties of the windows that lie in planes of constant z."""
    nodes = grid.blocks[0].nodes
    found = kinds(grid)
    return [
        found[w]
        for z in values
        for w in found
        if np.ptp(nodes[w.slices][..., 2]) == 0.0 and nodes[w.slices].flat[2] == z
    ]


@pytest.mark.parametrize(
    ("z", "taper"),
    [
        (np.linspace(2.0, 5.0, 3), 0.0),
        (np.linspace(0.0, 1.0, 7), 0.0),
        (np.linspace(-1.0, 2.0, 7), 0.1),
        (np.linspace(0.0, 30.0, 31), 0.0),  # farther apart than the far field is away
    ],
)
def test_both_planes_between_which_a_wing_spans_are_symmetry(z, taper):
    found = in_planes(extruded(z, taper=taper), z[[0, -1]])
    assert [kind for kind, _ in found] == ["symmetry", "symmetry"]


def test_a_root_plane_away_from_the_origin_slides_and_is_not_designed():
    grid = replace(onera_m6_grid((9, 13, 9)), patches=())
    turn = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix()
    moved = replace(grid, blocks=tuple(replace(b, nodes=(b.nodes + [0.0, 0.0, 7.0]) @ turn.T) for b in grid.blocks))
    model = fit_grid(with_guessed_patches(moved))
    mesh = moving_mesh(model)
    heights = model.control_points @ turn[:, 2] - 7.0
    in_plane = np.flatnonzero(np.abs(heights) < 1e-8)
    of_wing = np.intersect1d(in_plane, mesh.surface_ids)
    assert 0 < len(of_wing) < len(mesh.surface_ids) < len(in_plane)
    np.testing.assert_allclose(np.abs(mesh.in_plane_normals @ turn[:, 2]), 1.0, atol=1e-12)
    assert len(mesh.in_plane_rows) == len(of_wing)


@pytest.mark.parametrize("slope", [0.75, 1.5])
def test_an_oblique_plane_at_the_end_of_a_curved_wall_is_never_a_likely_wall(slope):
    nodes = extruded(np.linspace(0.0, 1.0, 7)).blocks[0].nodes.copy()
    nodes[..., 2] += slope * nodes[..., 1]
    found = kinds(Grid((Block(nodes, "sheared"),), source="sheared.xyz"))
    assert sorted(found.values()) == [("farfield", "sure"), ("wall", "sure"), *[("wall", "unsure")] * 2]


@pytest.mark.parametrize("stretch", [0.5, 5.0])
def test_inlets_and_outlets_of_pipes_are_far_field_where_walls_end_in_them_too(stretch):
    found = {(np.array(w.lo) == w.hi).argmax(): [] for w in kinds(pipe(stretch))}
    for window, (kind, _) in kinds(pipe(stretch)).items():
        found[(np.array(window.lo) == window.hi).argmax()].append(kind)
    assert found[0] == ["farfield", "farfield"]
    assert found[2] == ["symmetry", "symmetry"]


def test_planes_far_away_whose_cells_are_coarse_are_far_field_though_the_wing_reaches_them():
    z = 40.0 * np.sinh(np.linspace(-4.0, 4.0, 31)) / np.sinh(4.0)
    assert in_planes(extruded(z), z[[0, -1]]) == [("farfield", "sure")] * 2


def test_ends_of_a_bent_pipe_are_far_field():
    along, out, around = np.meshgrid(
        np.linspace(0.0, 1.0, 15), np.linspace(0.1, 1.0, 8), np.linspace(0.0, 1.0, 13), indexing="ij"
    )
    bend, angle = 1.1 * along, 2.0 * np.pi * around
    radius = 8.0 + (1.0 + 0.4 * along) * out * np.cos(angle)
    nodes = np.stack([radius * np.sin(bend), radius * np.cos(bend), (1.0 + 0.4 * along) * out * np.sin(angle)], axis=-1)
    nodes[:, :, -1] = nodes[:, :, 0]
    found = kinds(Grid((Block(nodes, "bend"),), source="bend.xyz"))
    assert [kind for window, (kind, _) in found.items() if window.lo[0] == window.hi[0]] == ["farfield", "farfield"]


@pytest.mark.parametrize("name", ["wing", "octant", "pipe", "deep section"])
def test_the_middle_of_a_grid_goes_along_with_it(name):
    grid = GRIDS[name]()
    frame, turn = GridFrame.of(grid), Rotation.from_rotvec([0.4, -0.9, 0.2]).as_matrix()
    moved = GridFrame.of(replace(grid, blocks=tuple(replace(b, nodes=b.nodes @ turn.T + 5.0) for b in grid.blocks)))
    np.testing.assert_allclose(moved.middle, turn @ frame.middle + 5.0, rtol=0.0, atol=1e-6 * frame.radius)
    assert moved.radius == pytest.approx(frame.radius, rel=1e-6)
