"""Lattices come from a user's own files of free-form boxes, of one block or several, on grids and on other meshes."""

import re
from functools import cache

import numpy as np
import pytest
from mesh_cases import mesh_around_a_body
from parametrization_cases import assert_exact, surface_of, wing_model
from scipy.interpolate import BSpline
from scipy.optimize import root

from bspline_mdao import InputError
from bspline_mdao.core.design.embedding import fixed_points
from bspline_mdao.core.design.variable import Layout
from bspline_mdao.design import FreeForm, InBox, Lattice, LatticeBlocks, Parametrization, read_lattice
from bspline_mdao.meshes import MeshModel
from bspline_mdao.movers import moving_mesh


@cache
def wing():
    return moving_mesh(wing_model())


@cache
def body():
    return moving_mesh(MeshModel.of(*mesh_around_a_body()))


def bent_box(mesh, n=(5, 3, 4)):
    """Points around the surface of a mesh that make no box."""
    x = Lattice.box(mesh, n, margin=0.4).control_points
    bend = [0.1 * np.sin(x[..., 2]), 0.05 * np.cos(3.0 * x[..., 0]), 0.1 * x[..., 0] * x[..., 1]]
    return x + np.stack(bend, axis=-1)


def write_box(path, *blocks):
    """Write blocks as pyGeo's files have them: text, with the number of blocks, i running fastest."""
    shapes = "\n".join(" ".join(map(str, block.shape[:3])) for block in blocks)
    numbers = "\n".join(" ".join(f"{x:.17g}" for x in block.transpose(3, 2, 1, 0).ravel()) for block in blocks)
    path.write_text(f"{len(blocks)}\n{shapes}\n{numbers}\n")
    return path


def by_definition(points, xi):
    """Point of a volume at parameters as pyGeo defines it: open knots, evenly spaced, order 4 or as many as points."""
    value = points
    for x, n in zip(xi, points.shape[:3]):
        order = min(4, n)
        knots = np.concatenate([np.zeros(order - 1), np.linspace(0.0, 1.0, n - order + 2), np.ones(order - 1)])
        value = np.tensordot(BSpline(knots, np.eye(n), order - 1)(x), value, axes=(0, 0))
    return value


@pytest.mark.parametrize(("mesh", "suffix"), [(wing, "xyz"), (body, "fmt")], ids=["grid", "mesh"])
def test_points_move_with_the_volume_of_a_file_as_pygeo_defines_it(tmp_path, mesh, suffix):
    mesh, random = mesh(), np.random.default_rng(5)
    box = bent_box(mesh)
    variable = FreeForm("box", read_lattice(write_box(tmp_path / f"box.{suffix}", box)))
    layout = Layout(mesh, variable.auxiliary)
    values = 0.1 * random.normal(size=box.shape)
    moved = variable.bind(layout).apply(layout.points, values.ravel())[layout.rows()]
    for row in random.choice(layout.n_surface, 4, replace=False):
        place = layout.points[row]
        xi = root(lambda x, place=place: by_definition(box, x) - place, np.full(3, 0.5), tol=1e-14).x
        np.testing.assert_allclose(moved[row], place + by_definition(values, xi), atol=1e-9)
    assert_exact(layout, variable)


def test_blocks_share_points_and_move_as_one(tmp_path):
    whole = Lattice.box(wing(), n=(4, 2, 4), orders=(4, 2, 4), margin=0.1)
    # cut in two along the span where a knot of its own full multiplicity does no harm: a Bezier volume and its halves
    outer = Lattice.box(np.stack([whole.points[0], whole.points[-1]]), n=(4, 2, 4), margin=0.0).control_points
    low, high = outer[0, 0, 0, 2], outer[0, 0, -1, 2]
    middle = low + 0.4 * (high - low)
    blocks = [outer.copy(), outer.copy()]
    blocks[0][..., 2] = low + 0.4 * (outer[..., 2] - low)
    blocks[1][..., 2] = middle + 0.6 * (outer[..., 2] - low)
    blocks[1][:, :, 0] += 1e-9  # what rounding in a file does
    lattice = read_lattice(write_box(tmp_path / "box.xyz", *blocks))
    assert isinstance(lattice, LatticeBlocks)
    assert lattice.points.shape == (2 * 32 - 8, 3)
    variable = FreeForm("box", lattice)
    layout = Layout(wing(), variable.auxiliary)
    matrix = np.eye(3) + 0.2 * np.random.default_rng(2).normal(size=(3, 3))
    values = (lattice.points @ matrix.T - lattice.points)[variable.point_ids(layout)]
    moved = variable.bind(layout).apply(layout.points, values.ravel())[layout.rows()]
    np.testing.assert_allclose(moved, surface_of(wing()) @ matrix.T, atol=1e-7)
    assert_exact(layout, variable)


def test_points_of_blocks_are_chosen_by_block_and_by_box():
    one = Lattice.box([[0.0, -0.1, -0.1], [1.5, 0.1, 0.8]], n=(4, 2, 3), margin=0.0).control_points
    other = one + [0.0, 0.0, 0.9]
    lattice = LatticeBlocks([one, other])
    of_block = lattice.chosen({1: np.s_[:, :, 1:]})
    np.testing.assert_array_equal(of_block, lattice.within(low=(None, None, 0.9)))
    assert of_block.sum() == 16
    assert lattice.chosen({0: np.s_[..., -1], 1: np.s_[..., 0]}).sum() == 8
    with pytest.raises(InputError, match=re.escape("where: there is no block 2; the lattice has (4, 2, 3), (4, 2, 3)")):
        FreeForm("box", lattice, where={2: ...}).point_ids(Layout(wing(), (lattice,)))


def test_only_outer_sides_are_fixed_where_the_surface_leaves_blocks():
    outboard = Lattice.box([[0.2, -0.1, 0.5], [1.7, 0.1, 1.0]], n=(3, 2, 4), margin=0.0).control_points
    tip = outboard + [0.0, 0.0, 0.5]
    lattice = LatticeBlocks([outboard, tip], continuity=1)
    fixed = fixed_points(lattice, Layout(wing(), (lattice,)))
    first, second = lattice.mesh.control_ids
    assert fixed[first[:, :, :2]].all()
    assert not fixed[second[1:, :, 1:]].any()


def test_a_child_from_a_file_goes_with_its_parent(tmp_path):
    parent = read_lattice(write_box(tmp_path / "parent.xyz", bent_box(wing())))
    inner = Lattice.box([[0.25, -0.09, 0.55], [1.45, 0.09, 1.5]], n=(4, 3, 5), margin=0.0).control_points
    child = read_lattice(write_box(tmp_path / "child.xyz", inner), parent=parent)
    random = np.random.default_rng(1)
    shape = Parametrization(wing(), [FreeForm("wing", parent), FreeForm("tip", child)])
    values = {name: 0.1 * random.normal(size=initial.shape) for name, initial in shape.initial.items()}
    both, alone = shape.apply(surface_of(wing()), values), {"wing": values["wing"], "tip": 0.0 * values["tip"]}
    outer = shape.apply(surface_of(wing()), alone)
    weights = child.weights(surface_of(wing()), child.find(surface_of(wing())).is_inside)
    tip = np.zeros_like(child.points)
    tip[shape.variables[1].point_ids(shape.layout)] = values["tip"].reshape(-1, 3)
    fixed = shape.mesh.in_plane_rows
    difference = both - outer - weights @ tip
    assert np.abs(np.delete(difference, fixed, axis=0)).max() < 1e-13
    with pytest.raises(InputError, match=r"lie outside the parent, the first is point \(\d, \d, \d\)"):
        read_lattice(tmp_path / "child.xyz", parent=Lattice.box(np.array([[0.5, 0, 0], [0.6, 0.1, 0.1]])))


SU2 = """NDIME= 2
FFD_NBOX= 2
FFD_NLEVEL= 1
FFD_TAG= MAIN
FFD_LEVEL= 0
FFD_DEGREE_I= 2
FFD_DEGREE_J= 1
FFD_BLENDING= BEZIER
FFD_CORNER_POINTS= 4
0.0 -0.1
1.0 -0.1
1.0 0.1
0.0 0.1
FFD_CONTROL_POINTS= 12
{points}
FFD_SURFACE_POINTS= 0
FFD_TAG= SOLID
FFD_DEGREE_I= 3
FFD_DEGREE_J= 2
FFD_DEGREE_K= 1
FFD_BLENDING= BSPLINE_UNIFORM
BSPLINE_ORDER_I= 3
BSPLINE_ORDER_J= 2
BSPLINE_ORDER_K= 2
FFD_CONTROL_POINTS= 24
{solid}
"""


def su2_box(path, skip=0):
    """A file of SU2 with two boxes; some control points of the second may be missing."""
    plane = [f"{i}\t{j}\t{k}\t{0.5 * i}\t{0.2 * j - 0.1}\t{k - 0.5}" for i, j, k in np.ndindex(3, 2, 2)]
    solid = [f"{i} {j} {k} {i} {j} {2 * k}" for i, j, k in np.ndindex(4, 3, 2)]
    path.write_text(SU2.format(points="\n".join(plane), solid="\n".join(solid[skip:])))
    return path


def test_boxes_of_su2_are_read_by_name(tmp_path):
    path = su2_box(tmp_path / "mesh.su2")
    main, solid = read_lattice(path, "MAIN"), read_lattice(path, "SOLID", continuity=0)
    assert main.orders == (3, 2, 2)
    np.testing.assert_allclose(main.control_points[1, 1], [[0.5, 0.1, 0.0], [0.5, 0.1, 1.0]], atol=1e-15)
    assert (solid.orders, solid.control_points.shape, solid.continuity) == ((3, 2, 2), (4, 3, 2, 3), 0)
    assert solid.points[-1].tolist() == [3.0, 2.0, 2.0]


def test_what_is_no_lattice_is_refused_in_one_line(tmp_path):
    path = su2_box(tmp_path / "mesh.su2", skip=1)
    with pytest.raises(InputError, match=r"FFD box 'SOLID': control point 24 is '"):
        read_lattice(path, "SOLID")
    path = su2_box(tmp_path / "mesh.su2")
    with pytest.raises(InputError, match="has several FFD boxes, MAIN, SOLID; name one"):
        read_lattice(path)
    with pytest.raises(InputError, match="no FFD box is called 'BOX'; there are MAIN, SOLID"):
        read_lattice(path, "BOX")
    (tmp_path / "none.su2").write_text("NDIME= 3\n")
    with pytest.raises(InputError, match="has no FFD boxes"):
        read_lattice(tmp_path / "none.su2")
    plate = write_box(tmp_path / "plate.xyz", bent_box(wing())[:, :1])
    with pytest.raises(InputError, match="block 1 is no volume"):
        read_lattice(plate)
    with pytest.raises(InputError, match="leave out 'BOX'"):
        read_lattice(plate, "BOX")


def test_points_outside_of_the_box_are_counted_and_measured(tmp_path):
    tip = Lattice.box([[0.25, -0.1, 0.55], [1.7, 0.1, 1.6]], margin=0.0).control_points
    lattice = read_lattice(write_box(tmp_path / "box.xyz", tip), moves=InBox())
    with pytest.raises(InputError, match=r"\d+ of the \d+ points it is to move lie outside, by up to 0.6\d* m"):
        Parametrization(wing(), [FreeForm("box", lattice)])
