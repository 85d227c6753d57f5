"""Named deformations: what they do to a surface, their derivatives, and the words that ask for them."""

from dataclasses import replace

import numpy as np
import pytest

from bspline_mdao import InputError, find_topology, fit_grid, read_grid
from bspline_mdao.core.design.deformation import (
    Bend,
    Deformation,
    Pitch,
    Rotate,
    RotateSections,
    ScaleChord,
    ScaleThickness,
    ShearDownstream,
    ShearUpwards,
    Stretch,
    Translate,
    amount_jvp,
    jvp,
    random_bumps,
    vjp,
)
from bspline_mdao.core.design.deformation_warnings import plane_warnings, stream_warnings
from bspline_mdao.core.design.hinge import NearestPart, RotatedPart
from bspline_mdao.core.design.lattice_deformation import LatticeDeformation
from bspline_mdao.core.design.named_deformations import DEFORMATIONS, PrescribedPoints
from bspline_mdao.core.design.section_maps import SCALED_AFTER_TURN
from bspline_mdao.core.mesh.frame import Frame, Plane, mesh_planes, surface_frame
from bspline_mdao.design import Lattice, parse_deformation
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.io.patch_guess import guess_patches
from bspline_mdao.movers import moving_mesh

SYMMETRY = Plane(np.array([0.0, 0.0, 1.0]), 0.0)


@pytest.fixture(scope="module")
def model():
    return fit_grid(onera_m6_grid((15, 13, 13)), n_control=(7, 6, 6))


@pytest.fixture(scope="module")
def mesh(model):
    return moving_mesh(model)


@pytest.fixture(scope="module")
def surface(mesh):
    return mesh.points[mesh.surface_ids]


def swept_wing(n=60, seed=0):
    """Points scattered over a swept wing of chord 1, thickness 0.2 and semi-span 3 on the plane z = 0."""
    rng = np.random.default_rng(seed)
    x, y, z = rng.uniform(0, 1, n), rng.uniform(-0.1, 0.1, n), rng.uniform(0, 3, n)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.1, 0], [0.5, -0.1, 0], [0, 0, 3], [1, 0, 3]])
    points = np.concatenate([np.stack([x, y, z], axis=1), corners])
    return points + np.outer(0.4 * points[:, 2], [1, 0, 0])


def lattice_map(points):
    """A bent lattice around points, its own points moved at random."""
    x = Lattice.box(points, n=(4, 3, 4), margin=0.3).control_points
    lattice = Lattice(x + 0.1 * np.sin(x[..., [2, 0, 1]] * [1.0, 2.0, 0.0]))
    displacement = 0.2 * np.random.default_rng(3).standard_normal(lattice.points.shape)
    return LatticeDeformation(lattice, displacement, 1.4)


def maps_of(points, planes=(SYMMETRY,)):
    frame = surface_frame(points, planes)
    return {
        "twist": RotateSections(frame, 0.7),
        "pitch": Pitch(frame, -0.3, at=0.4),
        "bend": Bend(frame, 1.3, at=0.5, length=0.2),
        "faint bend": Bend(frame, 1e-4, at=0.0, length=1.0),
        "stretch": Stretch(frame, 2.0),
        "chord": ScaleChord(frame, 0.5),
        "thickness": ScaleThickness(frame, 3.0),
        "sweep": ShearDownstream(frame, 0.4),
        "dihedral": ShearUpwards(frame, 0.2),
        "translate": Translate(np.array([0.1, 0.2, 0.0]), 1.5),
        "bumps": random_bumps(points, 0.05, 0.8, seed=4, planes=planes),
        "rotate": Rotate(
            np.array([[0.5, 0.1, 0.0], [0.9, 0.0, 2.0]]), 7.0, RotatedPart(NearestPart.of(points, points[:, 2] > 1.0))
        ),
        "given": PrescribedPoints(points[::-1], 0.3),
        "ffd": lattice_map(points),
    }


def difference(f, steps=(2e-3, 1e-3, 5e-4)):
    """Central differences, extrapolated."""
    table = [(f(h) - f(-h)) / (2 * h) for h in steps]
    for factor in (4.0, 16.0):
        table = [(factor * b - a) / (factor - 1) for a, b in zip(table, table[1:])]
    return table[0]


# derivatives


@pytest.mark.parametrize("name", maps_of(swept_wing()))
def test_derivatives_of_maps_are_exact_and_transposed(name):
    points, rng = swept_wing(), np.random.default_rng(7)
    point_map = maps_of(points)[name]
    d_points, bar = rng.standard_normal((2, *points.shape))
    is_smooth = np.ones(len(points), dtype=bool)
    if name.endswith("bend"):  # differences across the ends of the arc are none
        span = points[:, 2] / 3.0
        is_smooth = np.min(np.abs(span[:, None] - [point_map.at, point_map.at + point_map.length]), axis=1) > 4e-3
    exact = jvp(point_map, points, d_points)
    np.testing.assert_allclose(
        exact[is_smooth], difference(lambda h: point_map.apply(points + h * d_points))[is_smooth], atol=2e-9
    )
    assert np.sum(exact * bar) == pytest.approx(np.sum(d_points * vjp(point_map, points, bar)), rel=1e-12)
    moved = difference(lambda h: replace(point_map, amount=point_map.amount + h).apply(points))
    np.testing.assert_allclose(amount_jvp(point_map, points), moved, atol=2e-9)


@pytest.mark.slow
def test_derivatives_of_a_chain_of_deformations_are_exact_and_transposed(model, mesh, surface):
    deformation = parse_deformation("twist=40+bumps=0.05,seed=2+bend=70@0.2,length=0.9", model, mesh)
    rng = np.random.default_rng(5)
    d_points, bar = deformation.slide(rng.standard_normal(surface.shape)), rng.standard_normal(surface.shape)
    is_smooth = surface[:, 2] > 0.35  # outboard of where the arc begins
    np.testing.assert_allclose(
        deformation.jvp(surface, d_points)[is_smooth],
        difference(lambda h: deformation.apply(surface + h * d_points))[is_smooth],
        atol=1e-8,
    )
    off_planes = rng.standard_normal(surface.shape)
    forward, reverse = np.sum(deformation.jvp(surface, off_planes) * bar), deformation.vjp(surface, bar)
    assert forward == pytest.approx(np.sum(off_planes * reverse), rel=1e-12)


# what the maps do


def test_pitch_is_a_rigid_rotation_that_raises_the_nose():
    points = swept_wing()
    moved = maps_of(points)["pitch"].apply(points)
    distances = [np.linalg.norm(p[:, None] - p, axis=-1) for p in (points, moved)]
    np.testing.assert_allclose(*distances, atol=1e-13)
    raised = Pitch(surface_frame(points, (SYMMETRY,)), 0.1).apply(points)
    assert raised[points[:, 0].argmin(), 1] > points[points[:, 0].argmin(), 1]


def test_twist_turns_the_tip_by_its_angle_about_the_middle_of_the_chord():
    points = swept_wing()
    frame = surface_frame(points, (SYMMETRY,))
    moved = RotateSections(frame, np.radians(90.0)).apply(points)
    root, tip = points[:, 2] == 0.0, np.flatnonzero(points[:, 2] == 3.0)
    np.testing.assert_allclose(moved[root], points[root], atol=1e-15)
    np.testing.assert_array_equal(moved[:, 2], points[:, 2])
    chord = np.subtract(*moved[tip[::-1]])
    np.testing.assert_allclose(np.abs(chord), [0.0, 1.0, 0.0], atol=1e-12)
    assert moved[tip[0], 1] > moved[tip[1], 1]  # the leading edge goes up
    assert np.abs(moved[tip].mean(axis=0) - points[tip].mean(axis=0)).max() < 0.1


def test_bend_keeps_lengths_along_the_middle_and_folds_the_tip_by_its_angle():
    z = np.linspace(0.0, 2.0, 4001)
    wing = np.concatenate([np.stack([x + 0 * z, 0 * z, z], axis=1) for x in (0.0, 1.0)])
    moved = Bend(surface_frame(wing, (SYMMETRY,)), np.radians(120.0)).apply(wing)[: len(z)]
    steps = np.diff(moved, axis=0)
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), np.diff(z), rtol=1e-6)
    np.testing.assert_array_equal(moved[z <= 1.4], wing[: len(z)][z <= 1.4])
    assert np.degrees(np.arctan2(steps[-1, 1], steps[-1, 2])) == pytest.approx(120.0)


def test_bend_moves_all_behind_its_arc_as_a_rigid_body():
    points = swept_wing()
    bent = maps_of(points)["bend"].apply(points)
    beyond = points[:, 2] > 0.7 * 3.0
    distances = [np.linalg.norm(p[beyond][:, None] - p[beyond], axis=-1) for p in (points, bent)]
    np.testing.assert_allclose(*distances, atol=1e-13)


@pytest.mark.parametrize("angle", [0.9e-2, 1e-4, 1e-9])
def test_faint_bend_is_a_circle_to_round_off(angle):
    z = np.linspace(0.0, 3.0, 50)
    line = np.stack([np.tile([0.0, 1.0], 25), 0 * z, z], axis=1)
    moved = Bend(surface_frame(line, (SYMMETRY,)), angle, at=0.0, length=1.0).apply(line)
    radius, turn = 3.0 / angle, angle * z / 3.0
    np.testing.assert_allclose(moved[:, 1], 2.0 * radius * np.sin(0.5 * turn) ** 2, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(moved[:, 2], radius * np.sin(turn), rtol=1e-13)


def test_bend_by_nothing_leaves_points_in_place():
    points = swept_wing()
    np.testing.assert_allclose(Bend(surface_frame(points), 0.0).apply(points), points, atol=1e-15)


def test_stretch_chord_and_thickness_scale_the_box():
    points = swept_wing() * [1, 1, 1] - np.outer(swept_wing()[:, 2], [0.4, 0, 0])  # not swept
    maps = maps_of(points)
    for name, factors in {"stretch": (1, 1, 2), "chord": (0.5, 1, 1), "thickness": (1, 3, 1)}.items():
        np.testing.assert_allclose(
            np.ptp(maps[name].apply(points), axis=0), np.ptp(points, axis=0) * factors, rtol=0.06
        )
    sheared = maps["sweep"].apply(points) - points
    np.testing.assert_allclose(sheared, np.outer(points[:, 2], [np.tan(0.4), 0, 0]), atol=1e-14)


@pytest.mark.slow
def test_bumps_are_of_their_height_smooth_and_drawn_by_their_seed(surface):
    first, again, other = (random_bumps(surface, 0.03, 0.7, seed, (SYMMETRY,)) for seed in (1, 1, 2))
    moved = first.apply(surface)
    assert np.linalg.norm(moved - surface, axis=1).max() == pytest.approx(0.03)
    np.testing.assert_array_equal(moved, again.apply(surface))
    assert np.abs(other.apply(surface) - moved).max() > 0.01
    gradients = [jvp(first, surface, np.broadcast_to(axis, surface.shape)) - axis for axis in np.eye(3)]
    assert np.abs(gradients).max() < 2.0 * 2.0 * np.pi / 0.7 * 0.03  # so neighbours move alike


def test_bumps_leave_several_planes_of_symmetry_in_place():
    rng = np.random.default_rng(0)
    planes = (SYMMETRY, Plane(np.array([0.0, -1.0, 0.0]), -0.5), Plane(np.array([0.0, 0.0, -1.0]), -1.0))
    points = rng.uniform(0, 1, (50, 3))
    points[:20, 2], points[10:30, 1], points[40:, 2] = 0.0, 0.5, 1.0
    moved = random_bumps(points, 0.1, 0.5, 3, planes).apply(points)
    np.testing.assert_allclose(moved[:20, 2], 0.0, atol=1e-15)
    np.testing.assert_allclose(moved[10:30, 1], 0.5, atol=1e-15)
    np.testing.assert_allclose(moved[40:, 2], 1.0, atol=1e-15)
    assert np.abs(moved[:30, 0] - points[:30, 0]).max() > 0.01


# directions


@pytest.mark.parametrize(
    "name", [name for name in maps_of(swept_wing()) if name not in ("rotate", "translate", "bumps", "given", "ffd")]
)
@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_deformations_turn_with_the_surface_and_its_plane(name, angle):
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    turn = turn if angle else np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])  # z up, as other grids have it
    points = swept_wing()
    shift = np.array([0.3, -2.0, 1.0])
    turned = points @ turn.T + shift
    plane = Plane(-turn @ SYMMETRY.normal, float(-turn @ SYMMETRY.normal @ shift))
    there = maps_of(turned, (plane,))[name].apply(turned)
    np.testing.assert_allclose(there, maps_of(points)[name].apply(points) @ turn.T + shift, atol=1e-12)


def test_span_without_symmetry_is_the_longest_side_of_the_box():
    rng = np.random.default_rng(0)
    points = rng.uniform([-1, 0, -0.1], [0, 5, 0.1], (100, 3))
    frame = surface_frame(points)
    np.testing.assert_array_equal(frame.axes, np.eye(3)[[0, 2, 1]])
    np.testing.assert_allclose(frame.origin, points.min(axis=0))
    assert (frame.chord, frame.span) == pytest.approx((1.0, 5.0), rel=0.1)


def test_surface_without_span_is_refused():
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    with pytest.raises(InputError, match="no extent along its span"):
        surface_frame(flat, (SYMMETRY,))


@pytest.mark.slow
def test_planes_of_a_mesh_are_found_once(mesh):
    (plane,) = mesh_planes(mesh)
    assert (np.abs(plane.normal).tolist(), plane.offset) == ([0.0, 0.0, 1.0], pytest.approx(0.0, abs=1e-15))


# deformations of a mesh


@pytest.mark.slow
@pytest.mark.parametrize(
    "spec",
    [
        "twist=90deg",
        "bend=-120deg@0.6,length=0.3",
        "stretch=2",
        "chord=0.5",
        "thickness=2",
        "sweep=20",
        "dihedral=0.1rad",
        "pitch=5@0.5",
        "translate=0.1/-2e-1/0",
        "bumps=20cells,seed=3,wavelength=0.4",
        "bumps=0.02",
        "rotate=-30deg@hinge(0.5,0,0 -> 0.5,0,1),patches=*",
        "radius=1.3@axis(0,0,0 -> 1,0,0),along=0.1:0.9",
        "axial=0.8@axis(0,0,0 -> 1,0.2,0)",
    ],
)
def test_points_on_the_symmetry_plane_stay_exactly_in_it(model, mesh, surface, spec):
    deformation = parse_deformation(spec, model, mesh)
    moved = deformation.apply(surface)
    assert np.abs(moved - surface).max() > 0.01
    np.testing.assert_array_equal(moved[mesh.in_plane_rows, 2], surface[mesh.in_plane_rows, 2])


def test_every_name_is_tried_above():
    tried = test_points_on_the_symmetry_plane_stay_exactly_in_it.pytestmark[0].args[1]
    assert {spec.split("=")[0] for spec in tried} | {"ffd", "cad"} == set(DEFORMATIONS)  # these take files, see below


@pytest.mark.slow
def test_a_lattice_deforms_as_its_points_move_from_one_file_to_the_other(model, mesh, surface, tmp_path):
    before = Lattice.box(mesh, n=(4, 2, 3), margin=0.1).control_points
    matrix = np.array([[1.1, 0.2, 0.3], [0.0, 0.9, 0.1], [0.0, 0.0, 1.2]])
    for name, points in {"box": before, "moved": before @ matrix.T}.items():
        numbers = " ".join(map(repr, points.transpose(3, 2, 1, 0).ravel().tolist()))
        (tmp_path / f"{name}.xyz").write_text(f"1\n4 2 3\n{numbers}\n")
    box, moved = tmp_path / "box.xyz", tmp_path / "moved.xyz"
    deformation = parse_deformation(f"ffd={box},to={moved}", model, mesh)
    np.testing.assert_allclose(deformation.apply(surface), surface @ matrix.T, atol=1e-13)
    with pytest.raises(InputError, match="say where its points go"):
        parse_deformation(f"ffd={box}", model, mesh)
    with pytest.raises(InputError, match=r"\d+ of \d+ points of the surface lie outside, by up to .* m, the first at"):
        parse_deformation(f"stretch=2+ffd={box},to={moved}", model, mesh)
    moved.write_text(moved.read_text().replace("4 2 3", "2 4 3"))
    with pytest.raises(InputError, match=r"moved.xyz: has \(2, 4, 3\) points, and .*box.xyz has \(4, 2, 3\)"):
        parse_deformation(f"ffd={box},to={moved}", model, mesh)


def test_a_root_that_would_leave_its_plane_is_warned_of(model, mesh):
    (warning,) = plane_warnings(parse_deformation("translate=0/0/0.5", model, mesh), "m")
    assert warning.startswith("the deformation would take points out of their plane of symmetry, by up to 0.5 m; they")
    for text in (
        "twist=5",
        "sweep=10",
        "dihedral=10",
        "bend=90deg@0.5",
        "stretch=2",
        "translate=0.1/0.1/0",
        "bumps=0.02",
    ):
        assert plane_warnings(parse_deformation(text, model, mesh), "m") == ()


def test_a_surface_that_flies_backwards_is_warned_of_where_the_stream_matters(model, mesh):
    grid = onera_m6_grid((15, 13, 13))
    blocks = tuple(replace(block, nodes=block.nodes * [-1.0, -1.0, 1.0]) for block in grid.blocks)
    backwards = fit_grid(replace(grid, blocks=blocks), n_control=(7, 6, 6))
    control = moving_mesh(backwards)
    for text in ("twist=5", "pitch=5", "stretch=2+sweep=5"):
        (warning,) = stream_warnings(parse_deformation(text, backwards, control), backwards)
        assert warning.startswith("the stream is taken to run along +x, and the downstream end of the sections is the ")
        assert stream_warnings(parse_deformation(text, model, mesh), model) == ()
    for text in ("stretch=2", "translate=0.1/0/0", "thickness=1.1", "bumps=0.01"):
        assert stream_warnings(parse_deformation(text, backwards, control), backwards) == ()


@pytest.mark.parametrize(
    "turn",
    [
        "twist=5",
        "pitch=5",
        "bend=40@0.6",
        "rotate=5@hinge(0.5,0,0 -> 0.5,0,1),patches=*",
        "rotate=5@chord 0.7,blend=0.05",
    ],
)
def test_a_scaling_after_a_turn_changes_its_angle_and_is_noted(model, mesh, turn):
    late = parse_deformation(["stretch=1.1", turn, "sweep=2", "thickness=1.1"], model, mesh)
    assert late.notes == (SCALED_AFTER_TURN,)
    is_about_the_stream = turn.startswith("bend")  # which keeps lengths along the stream
    noted = () if is_about_the_stream else (SCALED_AFTER_TURN,)
    assert parse_deformation([turn, "chord=0.9"], model, mesh).notes == noted
    assert parse_deformation(["chord=0.9", "thickness=1.1", turn, "stretch=2"], model, mesh).notes == ()
    frame = Frame(np.zeros(3), np.eye(3), 1.0, 1.0, np.zeros((2, 2)))
    maps = {"thickness": ScaleThickness(frame, 1.1), "pitch": Pitch(frame, np.radians(-5.0), 0.0)}

    def angle(*order):
        x, y, _ = Deformation(mesh, tuple(map(maps.get, order))).apply_to_nodes(np.array([[1.0, 0.0, 0.5]]))[0]
        return np.degrees(np.arctan2(y, x))

    np.testing.assert_allclose(angle("thickness", "pitch"), 5.0, rtol=1e-12)
    np.testing.assert_allclose(angle("pitch", "thickness"), 5.4972, rtol=1e-4)


def test_deformations_are_done_one_after_the_other_each_on_what_the_last_has_left(model, mesh, surface):
    both = parse_deformation("stretch=2+bend=90@0.8", model, mesh)
    listed = parse_deformation(["stretch=2", "bend=90@0.8"], model, mesh)
    np.testing.assert_array_equal(both.apply(surface), listed.apply(surface))
    stretched = parse_deformation("stretch=2", model, mesh).apply(surface)
    span = surface[:, 2].max()
    is_inboard, is_beyond = surface[:, 2] < 0.8 * span, surface[:, 2] > 0.81 * span
    assert (surface[is_inboard, 2] > 0.45 * span).any()
    np.testing.assert_allclose(both.apply(surface)[is_inboard], stretched[is_inboard], atol=1e-14)
    assert np.abs(both.apply(surface) - stretched)[is_beyond].max(axis=1).min() > 1e-3


def test_height_in_cells_is_that_of_the_cells_at_the_wall(model, mesh, surface):
    spacing = model.wall_spacing()
    above = model.regenerate().blocks[4].nodes
    assert spacing == pytest.approx(np.median(np.linalg.norm(above[:, 1] - above[:, 0], axis=-1)), rel=1e-3)
    moved = parse_deformation("bumps=7cells", model, mesh).apply(surface)
    assert np.linalg.norm(moved - surface, axis=1).max() == pytest.approx(7 * spacing)


def test_leaving_the_symmetry_plane_is_refused(model, mesh, surface):
    with pytest.raises(
        InputError, match=r"point \(\d+, \d+, 1\) of block \d would leave its plane of symmetry by 0.5 m"
    ):
        parse_deformation("translate=0/0/0.5", model, mesh).apply(surface)
    across = Pitch(replace(surface_frame(surface, mesh_planes(mesh)), axes=np.eye(3)[[2, 1, 0]]), 0.3)
    with pytest.raises(InputError, match="plane of symmetry"):
        Deformation(mesh, (across,)).apply(surface)


def test_round_off_across_the_symmetry_plane_is_taken_off(mesh, surface):
    there = surface + [0.1, 0.0, 1e-12]
    moved = Deformation(mesh, (PrescribedPoints(there),)).apply(surface)
    np.testing.assert_array_equal(moved[mesh.in_plane_rows, 2], surface[mesh.in_plane_rows, 2])
    is_off = np.isin(np.arange(len(surface)), mesh.in_plane_rows, invert=True)
    np.testing.assert_array_equal(moved[is_off], there[is_off])


def test_points_of_another_surface_are_refused(model, mesh, surface):
    with pytest.raises(InputError, match="surface points of shape"):
        parse_deformation("stretch=2", model, mesh).apply(surface[1:])


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("", "nothing is asked for; the names are twist, bend"),
        ("twist", "not of the form name=value"),
        ("twist=thirty", "'thirty' is not an angle"),
        ("fold=30", "no deformation is called 'fold'; the names are twist, bend"),
        ("twist=30,seed=1", "'seed' is not known here; twist takes no option"),
        ("twist=30@0.5", "'@' is not known here"),
        ("bend=30@1.5", "1.5 is out of bounds"),
        ("bend=120@0.7,length=0.01", "the arc is too tight .* give a length above 0.0"),
        ("bend=400", "400 is out of bounds; give a number between -360 and 360"),
        ("sweep=90", "90 is out of bounds"),
        ("stretch=0", "give a number above 0"),
        ("chord=-1", "give a number above 0"),
        ("chord=nan", "'nan' is not a number"),
        ("bumps=0.1,wavelength=0", "give a number above 0"),
        ("translate=1,2,3", "'2' is not of the form name=value, .* are separated by slashes, as in translate=0"),
        ("translate=1/2", "translate=0.1/0/0"),
        ("stretch=2+", "2\\+"),
    ],
)
def test_words_that_are_not_understood_are_refused_in_one_line(model, mesh, spec, message):
    with pytest.raises(InputError, match=message) as error:
        parse_deformation(spec, model, mesh)
    assert "\n" not in str(error.value)


# files of points


@pytest.mark.parametrize("name", ["points.npy", "flat.npy", "points.csv", "headed.csv", "points.dat"])
def test_new_points_are_read_from_a_file(model, mesh, surface, tmp_path, name):
    wanted = surface + [0.1, 0.2, 0.0]
    if name == "flat.npy":
        np.save(tmp_path / name, wanted.ravel())
    elif name == "points.npy":
        np.save(tmp_path / name, wanted)
    else:
        comma = name.endswith("csv")
        heading = {"header": "x,y,z", "comments": "" if name == "headed.csv" else "# "}
        np.savetxt(tmp_path / name, wanted, fmt="%.17g", delimiter="," if comma else " ", **heading)
    moved = parse_deformation(str(tmp_path / name), model, mesh).apply(surface)
    np.testing.assert_array_equal(moved, wanted)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2,3\n", r"an array of shape \(1, 3\); the surface has \d+ points"),
        ("1,2\n", "not a list of points .point 1 has 2 coordinates"),
        ("x,y,z\n1,2,three\n", "not a list of points"),
        ("", r"shape \(0, 3\)"),
    ],
)
def test_files_that_hold_something_else_are_refused(model, mesh, tmp_path, text, message):
    (tmp_path / "points.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        parse_deformation(str(tmp_path / "points.csv"), model, mesh)


def test_points_that_are_not_finite_missing_or_pickled_are_refused(model, mesh, surface, tmp_path):
    bad = surface.copy()
    bad[6, 1] = np.nan
    np.save(tmp_path / "bad.npy", bad)
    np.save(tmp_path / "object.npy", np.array([{}], dtype=object))
    (tmp_path / "short.npy").write_bytes(b"\x93NUMPY")
    for name, message in {
        "bad": "point 7 is not finite",
        "none": "cannot be read",
        "object": "not a list of points",
        "short": "not a list of points",
    }.items():
        with pytest.raises(InputError, match=message):
            parse_deformation(str(tmp_path / f"{name}.npy"), model, mesh)


# real grids


WING = ("twist=20", "bend=60@0.6,length=0.4", "stretch=1.5", "chord=0.8", "dihedral=10", "bumps=20cells,seed=1")
REAL_WALLS = {
    "hh_naca0012_12blocks.xyz": WING,
    "pyhyp_m6_9blocks.xyz": WING,
    "vtk_bluntfin.bin": ("stretch=1.5", "chord=0.8", "sweep=10", "bumps=20cells"),  # two planes at right angles
    "mach_naca0012.cgns": ("twist=20", "pitch=5", "thickness=1.5", "bumps=20cells"),  # between two parallel planes
    "hopr_sphere_20blocks.cgns": ("twist=20", "bend=30@0.3,length=0.7", "stretch=2", "bumps=20cells"),  # no plane
}


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL_WALLS)
def test_walls_of_real_grids_can_be_deformed(real_grids, name):
    grid = read_grid(real_grids / name)
    windows = [face.window for face in find_topology(grid).boundary]
    model = fit_grid(replace(grid, patches=guess_patches(grid, windows)))
    mesh = moving_mesh(model)
    surface = mesh.points[mesh.surface_ids]
    for spec in REAL_WALLS[name]:
        moved = parse_deformation(spec, model, mesh).apply(surface)
        assert np.isfinite(moved).all()
        assert (moved != surface).any()
        off = np.sum((moved - surface)[mesh.in_plane_rows] * mesh.in_plane_normals, axis=1)
        np.testing.assert_allclose(off, 0.0, atol=1e-15 * mesh.size)


@pytest.mark.slow
def test_what_a_real_grids_planes_forbid_is_refused(real_grids):
    grid = read_grid(real_grids / "mach_naca0012.cgns")
    windows = [face.window for face in find_topology(grid).boundary]
    model = fit_grid(replace(grid, patches=guess_patches(grid, windows)))
    mesh = moving_mesh(model)
    with pytest.raises(InputError, match=r"would leave its plane of symmetry by 0\.5 m"):
        parse_deformation("stretch=1.5", model, mesh).apply(mesh.points[mesh.surface_ids])
