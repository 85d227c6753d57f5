"""Surfaces that are recognised from the nodes on them."""

import numpy as np
import pytest

from bspline_mdao import read_grid
from bspline_mdao.base.numerics.mean_planes import near_enough
from bspline_mdao.core.sliding.recognition import recognised_surface
from bspline_mdao.errors import InputError
from bspline_mdao.movers import Cone, Cylinder, Revolution, Sphere

PROFILES = {
    "Cylinder": lambda x: 1.3 + 0.0 * x,
    "Cone": lambda x: 0.4 + 0.3 * x,
    "Sphere": lambda x: np.sqrt(9.0 - (x - 1.0) ** 2),
    "Revolution": lambda x: 1.0 + 0.1 * np.sin(2.0 * x),
}


def face(kind, arc=1.0, skew=0.0, shape=(17, 15)):
    """Nodes of a piece of a surface of revolution about x, in rings or askew."""
    x, angle = np.meshgrid(np.linspace(0.3, 2.0, shape[0]), 0.1 + np.linspace(0.0, arc, shape[1]), indexing="ij")
    x = x + skew * np.sin(3.0 * angle)
    r = PROFILES[kind](x)
    return np.stack([x, r * np.cos(angle), r * np.sin(angle)], axis=-1)


def found(*faces):
    """The surface of nodes, and their distance from it by their size."""
    nodes = np.concatenate([f.reshape(-1, 3) for f in faces])
    surface = recognised_surface(faces, near_enough([nodes]), "grid: patch casing")
    return surface, surface.distances(nodes).max() / np.linalg.norm(np.ptp(nodes, axis=0))


def turned(points, seed=0):
    """Turn points about no coordinate axis, and shift them."""
    rng = np.random.default_rng(seed)
    return points @ np.linalg.qr(rng.normal(size=(3, 3)))[0].T + rng.normal(size=3)


@pytest.mark.parametrize("arc", [0.1, 1.0, 6.0])
@pytest.mark.parametrize("skew", [0.0, 0.1])
@pytest.mark.parametrize("kind", ["Cylinder", "Cone", "Sphere"])
def test_cylinders_cones_and_spheres_are_found_to_round_off_wherever_they_lie(kind, arc, skew):
    for nodes in (face(kind, arc, skew), turned(face(kind, arc, skew))):
        surface, distance = found(nodes)
        assert type(surface).__name__ == kind
        assert distance < 1e-14
    assert getattr(surface, {"Cone": "half_angle"}.get(kind, "radius")) == pytest.approx(
        {"Cylinder": 1.3, "Cone": np.arctan(0.3), "Sphere": 3.0}[kind], rel=1e-10
    )


@pytest.mark.parametrize("kind", PROFILES)
def test_digits_of_single_precision_are_enough(kind):
    offset = [0.0, 0.0, 0.0] if kind == "Revolution" else [30.0, -20.0, 10.0]
    surface, distance = found((face(kind, 0.5) + offset).astype(np.float32).astype(float))
    assert type(surface).__name__ == kind
    assert distance < 3e-6


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("skew", "limit"), [(0.0, 1e-14), (0.1, 1e-5)])
def test_surfaces_of_revolution_about_coordinate_axes_are_found_in_rings_or_not(axis, skew, limit):
    surface, distance = found(np.roll(face("Revolution", 1.0, skew), axis, axis=-1))
    assert isinstance(surface, Revolution)
    assert distance < limit
    np.testing.assert_array_equal(surface.direction, np.eye(3)[axis])


def test_the_sides_of_one_patch_have_one_surface():
    first, second = face("Cylinder")[:9], face("Cylinder")[8:].swapaxes(0, 1)
    surface, distance = found(first, second)
    assert isinstance(surface, Cylinder)
    assert distance < 1e-14


@pytest.mark.parametrize(("kind", "radii"), [(Cylinder, (1.0, 1.0)), (Cone, (1.0, 1.2))])
def test_two_circles_as_of_a_grid_one_cell_deep_are_on_no_sphere(kind, radii):
    angle = np.linspace(0.0, 2.0, 11)
    rings = [np.column_stack([np.full(11, x), r * np.cos(angle), r * np.sin(angle)]) for x, r in enumerate(radii)]
    assert isinstance(found(np.array(rings))[0], kind)


def test_pairs_of_mirror_images_are_no_rings():
    x, part = np.meshgrid(np.linspace(0.0, 2.0, 9), np.linspace(-1.0, 1.0, 11), indexing="ij")
    x = x + 0.1 * np.abs(part)  # so that no more than two nodes have one place along x
    nodes = np.stack([x, part, 1.0 + 0.1 * np.sin(x) + 0.3 * part**2], axis=-1)
    with pytest.raises(InputError, match=r"leaves its plane by .* m, a cylinder"):
        found(nodes)


def test_a_wedge_one_cell_deep_is_one_of_revolution():
    assert isinstance(found(face("Revolution", 0.05, shape=(17, 2)))[0], Revolution)


def test_what_is_no_such_surface_is_refused_with_what_was_tried():
    nodes = face("Cylinder")
    nodes[4, 5] *= 1.001
    with pytest.raises(
        InputError,
        match=r"grid: patch casing is to slide, but leaves its plane by 0\.\d+ m, a cylinder by 0\.00\d+ m, "
        r"a cone by .* m, a sphere by .* m, and surfaces of revolution about x, y and z; give its surface .*, or fix",
    ):
        found(nodes)
    with pytest.raises(InputError, match=r"leaves its plane by .* m, a cylinder"):
        found(turned(face("Revolution")))


@pytest.mark.parametrize("kind", [Cone, Sphere])
def test_a_face_that_shrinks_to_a_pole_is_none_of_its_own(kind):
    angle, r = np.linspace(0.0, 2.0, 11), np.linspace(0.0, 0.8, 9)[:, None]
    x = 2.0 * r if kind is Cone else np.sqrt(1.0 - r**2)
    nodes = np.stack([x + 0.0 * angle, r * np.cos(angle), r * np.sin(angle)], axis=-1)
    if kind is Sphere:
        assert isinstance(found(nodes)[0], Sphere)
    else:  # the apex has no tangent plane
        with pytest.raises(InputError, match=r"leaves its plane by .* m, a cylinder"):
            found(nodes)


def test_a_real_body_of_revolution_is_found(real_grids):
    faces = [block.nodes[:, :, 0] for block in read_grid(real_grids / "cfl3d_axibump.fmt").blocks]
    surface, distance = found(*faces)
    assert isinstance(surface, Revolution)
    assert distance < 1e-7
