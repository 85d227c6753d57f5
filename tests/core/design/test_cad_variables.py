"""Walls follow moved faces of CAD files: second files of the same topology, and control points as design variables."""

from dataclasses import replace

import numpy as np
import openmdao.api as om
import pytest
from cad_cases import foreign_file, needs_opencascade
from mesh_cases import mesh_around_a_body
from riding_cases import su2_text

from bspline_mdao import DesignSurface, GridMovement, InputError, fit_grid, read_grid
from bspline_mdao.base.numerics.vectors import lengths
from bspline_mdao.core.cad.files import quiet
from bspline_mdao.core.design.cad_deformation import CadDeformation
from bspline_mdao.core.design.variable import Layout
from bspline_mdao.design import CadPoints, CadShapes, CadWalls, TiedSurface, parse_deformation
from bspline_mdao.files import read_cad, read_mesh, write_cad, write_cad_body
from bspline_mdao.generators import ball_grid, onera_m6_grid
from bspline_mdao.meshes import MeshModel
from bspline_mdao.studio.cli.main import run
from bspline_mdao.testing import check_totals, dot_test

pytestmark = needs_opencascade

TOLERANCE = 1e-5


@pytest.fixture(scope="module")
def wing(tmp_path_factory):
    """A wing, its walls as a file, and those of its control points twisted."""
    folder = tmp_path_factory.mktemp("wing")
    model = fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4))
    model.save(folder / "wing.h5")
    surface = DesignSurface.of(model)
    moved, ids = model.control_points.copy(), surface.mesh.surface_ids
    moved[ids] = parse_deformation("twist=5deg", model, surface.mesh).apply(moved[ids])
    write_cad(folder / "wing.step", model, tolerance=TOLERANCE)
    write_cad(folder / "twisted.step", model, moved, tolerance=TOLERANCE)
    return folder, surface, moved


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    path = tmp_path_factory.mktemp("ball") / "ball.step"
    model = fit_grid(ball_grid((9, 9, 9, 9)))
    write_cad(path, model)
    return TiedSurface.of(model, path)


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """A mesh without structure around a block, and a box of a stranger, in millimetres, that is its wall."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

    model, path = MeshModel.of(*mesh_around_a_body()), tmp_path_factory.mktemp("block") / "box.step"
    walls = 1000.0 * model.mesh.points[model.wall_rows]
    with quiet():
        writer = STEPControl_Writer()
        low, high = (gp_Pnt(*end.tolist()) for end in (walls.min(axis=0), walls.max(axis=0)))
        writer.Transfer(BRepPrimAPI_MakeBox(low, high).Shape(), STEPControl_StepModelType.STEPControl_AsIs)
        writer.Write(str(path))
    return TiedSurface.of(model, path)


def splines(model, control_points, rows):
    return model.evaluator().forward(control_points).reshape(-1, 3)[rows]


def test_a_second_file_moves_walls_to_those_of_the_twisted_model(wing):
    folder, surface, moved = wing
    model, rows = surface.model, surface.surface.rows
    tied = TiedSurface.of(model, folder / "wing.step")
    before, after = (splines(model, points, rows) for points in (model.control_points, moved))
    at_splines = replace(tied, tie=tied.body.tie(before))
    found = at_splines.nodes(tied.shape(folder / "twisted.step")) - tied.surface.points + before
    assert lengths(after - before).max() > 0.02
    assert lengths(found - after).max() < 2.0 * TOLERANCE


def test_the_command_moves_the_walls_of_a_grid_by_two_files(wing, monkeypatch, tmp_path, capsys):
    folder, surface, _ = wing
    monkeypatch.chdir(folder)
    words = "cad=wing.step,to=twisted.step"
    assert run(["move", "wing.h5", "--deform", words, "-o", str(tmp_path / "moved.xyz")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "walls, within 0.016 m of the faces of wing.step, go where twisted.step has these" in said
    nodes = read_grid(tmp_path / "moved.xyz").to_vector().reshape(-1, 3)[surface.surface.rows]
    body = read_cad("wing.step").body
    asked = body.displacement(body.matched(read_cad("twisted.step").body), body.tie(surface.surface.points))
    assert lengths(nodes - surface.surface.points - asked).max() < 1e-9
    assert lengths(asked).max() > 0.02


def test_the_command_moves_a_mesh_without_structure_by_two_files(block, tmp_path, capsys):
    folder = tmp_path
    write_cad_body(folder / "a.step", block.body, units="mm")
    write_cad_body(folder / "b.step", block.body.at(block.body.control_points * [1.2, 1.1, 1.0]), units="in")
    (folder / "mesh.su2").write_text(su2_text(block.model.mesh))
    replace(block.model, mesh_file=str(folder / "mesh.su2")).save(folder / "mesh.h5")
    words = f"cad={folder}/a.step,to={folder}/b.step"
    assert run(["move", str(folder / "mesh.h5"), "--deform", words, "-o", str(folder / "moved.su2")]) == 0
    assert "m of the faces of" in capsys.readouterr().out
    rows, at_rest = block.model.wall_rows, block.model.mesh.points
    found = read_mesh(folder / "moved.su2").mesh.points[rows]
    np.testing.assert_allclose(found, at_rest[rows] * [1.2, 1.1, 1.0], atol=1e-9)


def test_words_without_a_second_file_or_of_other_faces_are_refused(wing, tmp_path):
    folder, surface, _ = wing
    for words, message in (
        (f"cad={folder}/wing.step", "say which file has the faces moved, such as cad=wing.step,to=twisted.step"),
        (
            f"cad={foreign_file(tmp_path / 'a.step')},to={folder}/wing.step",
            "of the walls' size; correct the surface, or",
        ),
        (f"cad={folder}/wing.step,to={tmp_path}/a.step", "and has 8 faces, not 2; write both with the same topology"),
        (f"cad={folder}/wing.step,to={folder}/wing.step,scale=25.4", "give a scale: the faces are 25"),
    ):
        with pytest.raises(InputError) as error:
            parse_deformation(words, surface.model, surface.mesh)
        assert message in str(error.value)


def test_faces_whose_parameters_run_otherwise_are_refused(wing):
    body = read_cad(wing[0] / "wing.step").body
    face = body.faces[0]
    turned = replace(
        face.surface,
        knots=(1.0 - face.surface.knots[0][::-1], face.surface.knots[1]),
        control_points=face.surface.control_points[::-1],
    )
    with pytest.raises(InputError, match=r"come apart by .* m along their edge: their parameters run otherwise"):
        body.matched(replace(body, faces=(replace(face, surface=turned), *body.faces[1:])))


def test_faces_of_a_stranger_are_matched_where_they_are_the_same_and_refused_where_an_edge_moved_on_them(tmp_path):
    body, other = (read_cad(foreign_file(tmp_path / f"{sweep}.step", sweep)).body for sweep in (350.0, 450.0))
    assert body.matched(read_cad(foreign_file(tmp_path / "again.step")).body).names == body.names
    with pytest.raises(
        InputError, match=r"is cut there, and the cut has moved on it\. .* cuts that stay where they are on both"
    ):  # the tip is cut elsewhere in (u, v)
        body.matched(other)


def test_the_derivative_of_a_deformation_by_files_is_that_of_its_places(ball):
    rng, body = np.random.default_rng(1), ball.body
    moved = body.at(body.control_points + rng.uniform(-0.1, 0.1, body.control_points.shape))
    deformation = CadDeformation(body, moved, 0.7)
    points = ball.surface.points[::7] * 1.02
    change = rng.normal(size=points.shape)
    product = deformation.apply(points + 1e-40j * change).imag / 1e-40
    step = 1e-6
    ends = [deformation.apply(points + side * step * change) for side in (1.0, -1.0)]
    is_inside = (np.abs(body.tie(points).uv - 0.5) < 0.49).all(axis=1)  # elsewhere faces change
    assert is_inside.sum() > 10
    np.testing.assert_allclose(product[is_inside], ((ends[0] - ends[1]) / (2.0 * step))[is_inside], atol=1e-7)


def test_products_with_control_points_are_exact_and_each_others_transposes(ball):
    rng = np.random.default_rng(2)
    points = ball.body.control_points
    change = rng.normal(size=points.shape)
    moved = ball.nodes(ball.body.at(points + change))
    np.testing.assert_allclose(ball.jvp(change), moved - ball.surface.points, atol=1e-12)
    assert dot_test(ball.jvp, ball.vjp, points.shape, moved.shape) < 1e-14


def test_control_points_move_walls_of_a_mesh_exactly_and_stay_in_its_plane_of_symmetry(block):
    variable, design = CadPoints("corners", block), DesignSurface.of(block.model)
    assert len(block.body.control_points) == 8  # corners of three faces each are one
    assert len(variable.initial) == 8 * 3 - 4  # four of them stay in y = 0
    shape = design.parametrization([variable])
    at_rest = design.mesh.points[design.mesh.surface_ids]
    values = 0.1 * np.random.default_rng(3).normal(size=len(variable.initial))
    moved = shape.apply(at_rest, {"corners": values})
    np.testing.assert_allclose(moved, block.nodes(variable.body_at(values)), atol=1e-12)
    assert np.abs(moved - at_rest).max() > 0.05
    is_on = at_rest[:, 1] == 0.0
    np.testing.assert_array_equal(moved[is_on][:, 1], 0.0)
    shifted = block.nodes(
        block.body.at(block.body.control_points + [0.1, 0.2, 0.3])
    )  # the faces leave it, nodes do not
    np.testing.assert_allclose(
        shifted - at_rest, np.where(is_on[:, None], [0.1, 0.0, 0.3], [0.1, 0.2, 0.3]), atol=1e-12
    )


def test_edges_of_faces_stay_closed_whatever_control_points_do(tmp_path):
    body = read_cad(foreign_file(tmp_path / "a.step")).body
    first, second = body.joints
    assert len(first.faces) > 100
    gaps = lengths(body.places(first) - body.places(second))
    rng, points = np.random.default_rng(4), body.control_points
    moved = body.at(points + ~body.is_fixed[:, None] * rng.uniform(-0.01, 0.01, points.shape))
    assert 0 < np.count_nonzero(body.is_fixed) < len(points)
    assert lengths(moved.places(first) - moved.places(second)).max() <= gaps.max() + 1e-9
    wild = body.at(points + rng.uniform(-0.01, 0.01, points.shape))
    assert lengths(wild.places(first) - wild.places(second)).max() > 1e-3


def test_walls_of_a_grid_are_exactly_where_control_points_of_faces_put_them_with_exact_totals(ball):
    chosen = ball.body.control_points[:, 0] > 0.2
    points = CadPoints("bumps", ball, where=chosen, direction="yz")
    shapes = CadShapes("larger", ball, [ball.body.at(1.1 * ball.body.control_points)])
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("walls", CadWalls(variables=[points, shapes]), promotes=["*"])
    movement = GridMovement(model=ball.model, surface=ball.surface, fit=False)
    problem.model.add_subsystem("grid", movement, promotes=["*"])
    problem.setup(force_alloc_complex=True)
    values = 0.02 * np.random.default_rng(7).normal(size=len(points.initial))
    problem.set_val("bumps", values)
    problem.set_val("larger", 0.3)
    problem.run_model()
    asked = ball.nodes(points.body_at(values)) + 0.3 * (ball.nodes(shapes.shapes[0]) - ball.surface.points)
    nodes = problem.get_val("grid").reshape(-1, 3)[ball.surface.rows]
    assert np.abs(nodes - asked).max() < 1e-14
    found = check_totals(problem, of=["grid"], wrt=["bumps", "larger"])
    assert found.transposed < 1e-12
    assert found.differences < 1e-9


def test_as_design_variables_they_move_control_points_as_nodes_that_are_given_do(ball):
    design = DesignSurface.of(ball.model)
    shapes = CadShapes("larger", ball, [ball.body.at(1.2 * ball.body.control_points)])
    shape = design.parametrization([shapes, CadPoints("bumps", ball, where=[3, 5], direction="x")])
    at_rest = design.mesh.points[design.mesh.surface_ids]
    moved = shape.apply(at_rest, {"larger": np.array([0.5]), "bumps": np.zeros(2)})
    assert lengths(moved - 1.1 * at_rest).max() < 0.01
    bound = shapes.bind(Layout(design.mesh))
    np.testing.assert_allclose(bound.matrix @ [2.0], (bound.apply(at_rest, np.array([2.0])) - at_rest).ravel())


def test_variables_that_move_nothing_are_refused(ball, block):
    with pytest.raises(InputError, match=r"where: .*; the faces have 8 control points"):
        CadPoints("a", block, where=[99]).point_ids  # noqa: B018
    on_plane = block.body.control_points[:, 1] == 0.0
    with pytest.raises(InputError, match="all of its control points lie in a plane of symmetry and would leave it"):
        CadPoints("a", block, where=on_plane, direction="y").of_nodes  # noqa: B018
    with pytest.raises(InputError, match="there is no shape to go to"):
        CadShapes("a", ball)
