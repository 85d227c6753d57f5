"""The command ``move``: what it writes, tells and refuses."""

import os
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import openmdao.api as om
import pytest
from component_cases import movable_model, small_model
from mover_cases import flare_grid
from periodic_cases import PITCH, passage, untied
from test_cli import fails_as_expected, numbers
from topology_cases import box, c_grid, grid_of

from bspline_mdao import FittedModel, GridMovement, find_topology, fit_grid, read_grid
from bspline_mdao.base.numerics import progress
from bspline_mdao.core.evaluation.evaluator import Evaluator
from bspline_mdao.core.fit.surface_fit import SurfaceFollower
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.movement.elasticity import LinearElasticity
from bspline_mdao.core.movement.transfinite import Transfinite
from bspline_mdao.core.movement.young_modulus import ConstantLaw
from bspline_mdao.core.walls.wall_correction import WallCorrection
from bspline_mdao.design import parse_deformation
from bspline_mdao.generators import flat_plate_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import inverted_cells, report_quality
from bspline_mdao.grids.io.files import write_grid
from bspline_mdao.grids.topology.grid import Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import Rotations
from bspline_mdao.studio.cli.cures import Trial
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.cli.move import complaint
from bspline_mdao.studio.cli.movers import MOVERS, SOLVERS, STIFFNESS

FLOOR = ["--deform", "bumps=0.02,seed=3,wavelength=0.8"]


@pytest.fixture(scope="module")
def model():
    return movable_model()


@pytest.fixture
def workplace(tmp_path, monkeypatch, model):
    monkeypatch.chdir(tmp_path)
    model.save("floor.h5")
    return tmp_path


def move(*arguments):
    return ["move", "floor.h5", *arguments, "-o", "moved.xyz", "--overwrite", "--json", "m.json"]


def test_nothing_is_proved_of_a_move_where_that_is_not_wanted(workplace, capsys):
    assert run(move(*FLOOR)) == 0
    assert "is proved positive everywhere" in capsys.readouterr().out
    proved = numbers("m.json")
    assert proved["certificate"]["status"] == "valid"
    assert run(move(*FLOOR, "--no-certify")) == 0
    assert "is proved positive" not in capsys.readouterr().out
    unproved = numbers("m.json")
    assert unproved["certificate"] is None
    assert unproved["after"] == proved["after"]


@pytest.mark.slow
def test_move_writes_the_grid_behind_the_moved_surface(workplace, model, capsys):
    assert run(move(*FLOOR, "--surface", "new.csv")) == 0
    mesh = moving_mesh(model)
    surface = np.loadtxt("new.csv", delimiter=",")
    moved = Rotations(mesh).move(model.control_points, surface).points
    wall = SurfaceGrid.of(model)
    nodes = parse_deformation(FLOOR[1], model, mesh).apply_to_nodes(wall.points)
    np.testing.assert_allclose(
        surface, SurfaceFollower.of(model, mesh, wall).at(nodes).control_points, rtol=0, atol=1e-15
    )
    spread = WallCorrection.of(model.topology, model.regenerate().to_vector().reshape(-1, 3), wall.rows)
    expected = model.grid_map().meeting(spread).at(moved, nodes).nodes
    np.testing.assert_allclose(read_grid("moved.xyz").to_vector(), expected.ravel(), atol=1e-12)
    found, table = numbers("m.json"), capsys.readouterr().out
    assert (found["n_control_points"], found["n_surface_control_points"]) == (mesh.n_points, len(surface))
    largest = np.linalg.norm(surface - model.control_points[mesh.surface_ids], axis=1).max()
    assert found["largest_displacement"] == pytest.approx(largest, rel=1e-12)
    assert largest > 0.01
    assert [set(row) for row in found["increments"]] == [
        {
            "solver",
            "iterations",
            "residual",
            "seconds",
            "digits",
            "n_invalid",
            "n_tangled",
            "place",
            "min_corner",
            "corner_ratio",
        }
    ]
    assert found["n_increments"] == 1
    assert 0.1 < found["increments"][-1]["corner_ratio"] < 1.0
    assert "1 increment" in table
    assert all(row["residual"] < 1e-12 for row in found["increments"])
    assert found["digits"] == min(row["digits"] for row in found["increments"]) > 12.0
    assert "digits of the displacements" not in table
    assert found["before"]["q_min"] != found["after"]["q_min"] > 0.0
    assert (found["newly_inverted"], found["after"]["n_inverted"]) == ([], 0)
    assert all(text in table for text in ("residual", "mean Q", found["increments"][0]["solver"], "moved.xyz written"))


def test_a_move_that_changes_the_heights_of_first_cells_says_so(workplace, capsys):
    assert run(move("--deform", "translate=0/0/0.3", "--mover", "transfinite")) == 0
    (floor,) = numbers("m.json")["heights"]
    assert (floor["patch"], floor["n_nodes"]) == ("floor", 128)
    assert floor["ratio_min"] < floor["ratio_median"] < 1.0
    table = " ".join("".join(capsys.readouterr()).split())
    assert "heights of the first cells at walls, relative to the baseline" in table
    assert ("the first cells at 'floor' are" in table) == (floor["n_off"] > 1)
    assert floor["n_off"] > 1
    assert run(move("--deform", "translate=0/0/0.001")) == 0
    assert "warning" not in "".join(capsys.readouterr())


def test_surface_points_are_read_back_as_they_were_written(workplace, model):
    assert run(move(*FLOOR, "--surface", "new.csv", "--mover", "transfinite")) == 0
    assert run(move("--deform", "new.csv", "--surface", "again.csv", "--mover", "transfinite")) == 0
    assert Path("again.csv").read_bytes() == Path("new.csv").read_bytes()
    points = Transfinite(moving_mesh(model)).move(model.control_points, np.loadtxt("new.csv", delimiter=",")).points
    np.testing.assert_array_equal(read_grid("moved.xyz").to_vector(), model.regenerate(points).to_vector())


@pytest.mark.slow
def test_no_deformation_gives_the_baseline_back(workplace, model):
    assert run(move("--deform", "translate=0/0/0")) == 0
    np.testing.assert_array_equal(read_grid("moved.xyz").to_vector(), model.regenerate().to_vector())


def test_a_move_finds_the_basis_functions_of_the_nodes_once(workplace, monkeypatch):
    made, of_grid = [], Evaluator.of_grid
    monkeypatch.setattr(Evaluator, "of_grid", lambda *arguments: made.append(1) or of_grid(*arguments))
    assert run(move("--deform", "bumps=0.2cells,seed=3", "--mover", "held")) == 0  # which measures cells
    assert len(made) == 1


def test_deformations_are_done_in_turn(workplace):
    assert run(move("--deform", "translate=0/0/0.03", "--deform", "translate=0/0.01/-0.01", "--mover", "held")) == 0
    assert numbers("m.json")["largest_displacement"] == pytest.approx(np.hypot(0.01, 0.02))


def test_options_reach_the_mover(workplace, monkeypatch):
    made = []

    class Watched(LinearElasticity):
        def move(self, initial, surface):
            made.append(self)
            return super().move(initial, surface)

    monkeypatch.setattr(MOVERS["elasticity"], Watched)
    options = [
        "--mover",
        "elasticity",
        "--increments",
        "2",
        "--nu",
        "0.3",
        "--stiffness",
        "constant",
        "--solver",
        "cholesky",
    ]
    assert run(move(*FLOOR, *options)) == 0
    (mover,) = made
    assert (mover.n_increments, mover.poisson_ratio, mover.stiffness) == (2, 0.3, ConstantLaw())
    assert len(numbers("m.json")["increments"]) == 2


@pytest.mark.slow
def test_the_far_field_goes_along_where_it_is_asked_to(workplace, model):
    assert run(move("--deform", "translate=0/0.3/0.1", "--mover", "elasticity", "--increments", "1", "--comoving")) == 0
    shift = read_grid("moved.xyz").to_vector() - model.regenerate().to_vector()
    normals = moving_mesh(model).plane_normals
    expected = np.array([0.0, 0.3, 0.1])
    assert np.abs(normals @ expected).max(initial=0.0) == 0.0
    np.testing.assert_allclose(shift.reshape(-1, 3), np.tile(expected, (model.n_nodes, 1)), rtol=0, atol=1e-12)


@pytest.mark.parametrize("mover", MOVERS)
def test_every_mover_moves(workplace, mover):
    fit_grid(flat_plate_grid((5, 5, 5))).save("plate.h5")
    bumps = ["--deform", "bumps=0.002,seed=3,wavelength=0.8", "-o", "moved.xyz", "--json", "m.json"]
    assert run(["move", "plate.h5", *bumps, "--mover", mover]) == 0
    assert numbers("m.json")["mover"] == mover


@pytest.mark.parametrize("stiffness", STIFFNESS)
def test_every_stiffness_moves(workplace, stiffness):
    assert run(move(*FLOOR, "--mover", "elasticity", "--increments", "1", "--stiffness", stiffness)) == 0


@pytest.mark.parametrize(
    ("mover", "options", "n_made"),
    [("elasticity", [], 5), ("elasticity", ["--increments", "3"], 3), ("transfinite", [], 1), ("rotations", [], 1)],
)
def test_increments_are_given_or_those_of_the_mover(workplace, mover, options, n_made):
    assert run(move("--deform", "bumps=0.2,seed=3,wavelength=0.8", "--mover", mover, "--allow-invalid", *options)) == 0
    found = numbers("m.json")
    assert (found["n_increments"], len(found["increments"])) == (n_made, n_made)


@pytest.mark.parametrize("increments", ["auto", "0", "1.5"])
def test_what_is_no_number_of_increments_is_refused(workplace, capsys, increments):
    assert run(move(*FLOOR, "--mover", "elasticity", "--increments", increments)) != 0
    assert "--increments" in capsys.readouterr().err


def test_components_that_are_asked_for_the_same_nodes_give_the_same_grid(workplace, model):
    assert run(move(*FLOOR, "--mover", "elasticity", "--increments", "2")) == 0
    mesh, surface = moving_mesh(model), SurfaceGrid.of(model)
    problem = om.Problem(reports=None)
    mover = LinearElasticity(mesh, n_increments=2)
    movement = GridMovement(model=model, mover=mover, surface=surface, fit=False)
    problem.model.add_subsystem("movement", movement, promotes=["*"])
    problem.setup(derivatives=False)
    asked = parse_deformation(FLOOR[1], model, mesh)
    problem.set_val("surface", asked.apply_to_nodes(surface.points, surface.on_planes(model)).ravel())
    problem.run_model()
    np.testing.assert_array_equal(read_grid("moved.xyz").to_vector(), problem.get_val("grid"))


def test_the_wall_is_where_the_deformation_puts_its_nodes(workplace, model, capsys):
    assert run(move("--deform", "bend=20deg", "--allow-invalid", "--surface", "new.csv")) == 0
    wall, miss = SurfaceGrid.of(model), numbers("m.json")["miss"]
    mesh = moving_mesh(model)
    bend = parse_deformation("bend=20deg", model, mesh)
    target = bend.apply_to_nodes(wall.points, wall.on_planes(model))
    grid = read_grid("moved.xyz").to_vector().reshape(-1, 3)
    np.testing.assert_allclose(grid[wall.rows], target, rtol=0, atol=1e-12)
    moved = LinearElasticity(mesh).move(model.control_points, np.loadtxt("new.csv", delimiter=","))
    alone = model.regenerate(moved.points).to_vector().reshape(-1, 3)[wall.rows]
    distances = np.linalg.norm(alone - target, axis=1)
    assert miss["largest"] == pytest.approx(distances.max(), rel=1e-6)
    assert miss["largest"] > 1e-3
    assert miss["rms"] == pytest.approx(np.sqrt(np.mean(distances**2)), rel=1e-6)
    assert miss["patch"] in wall.patches
    printed = " ".join("".join(capsys.readouterr()).split())
    assert "the wall's nodes are where the deformation puts them; of control points alone" in printed
    assert f"misses its target by {miss['largest']:.3g} m at most" in printed
    assert run(move("--deform", "new.csv", "--allow-invalid")) == 0
    assert numbers("m.json")["miss"] is None


def test_help_knows_all_names(capsys):
    assert run(["move", "--help"]) == 0
    text = capsys.readouterr().out
    assert [name for name in (*MOVERS, *STIFFNESS, *SOLVERS) if name not in text] == []


def strip_model(kind):
    """A C-grid about a wing section with thin cells at the wall, one cell deep between two planes of a kind."""
    thin = np.unique(np.rint(200 * np.linspace(0.0, 1.0, 19) ** 2)).astype(int)
    nodes = c_grid(n_wake=8, n_wing=16, n_off=201, n_span=2)[:, :, thin]
    whole = Window.whole(0, nodes.shape[:3])
    patches = (
        Patch("section", "wall", (Window(0, (8, 0, 0), (40, 1, 0)),)),
        Patch("rim", "farfield", (whole.face(5), whole.face(0), whole.face(1))),
        Patch("sides", kind, (whole.face(2), whole.face(3))),
    )
    return fit_grid(grid_of(nodes, patches=patches))


@pytest.fixture
def strip(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    strip_model("other").save("strip.h5")
    return ["move", "strip.h5", "-o", "moved.xyz", "--overwrite", "--json", "m.json", "--deform", "pitch=5deg"]


@pytest.mark.slow
def test_sides_of_no_known_kind_follow_a_section_as_planes_of_symmetry_do(strip):
    assert run(strip) == 0
    found, moved = numbers("m.json"), read_grid("moved.xyz").to_vector()
    assert found["after"]["n_inverted"] == 0
    strip_model("symmetry").save("strip.h5")
    assert run(strip) == 0
    np.testing.assert_allclose(moved, read_grid("moved.xyz").to_vector(), atol=1e-12)


@pytest.mark.slow
def test_blocks_that_stay_are_reported(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    nodes = box(*(np.linspace(0.0, 1.0, n) for n in (5, 6, 7)))
    floor = Patch("floor", "wall", (Window(0, (0, 0, 0), (4, 5, 0)),))
    fit_grid(grid_of(nodes, nodes + 2.0, patches=[floor])).save("apart.h5")
    assert run(["move", "apart.h5", "--deform", "translate=0/0/0.1", "-o", "moved.xyz"]) == 0
    said = " ".join("".join(capsys.readouterr()).split())
    assert "warning: blocks that stay where they are, 1 of 2, such as block 2: no point there" in said


@pytest.mark.slow
def test_fit_and_move_count_invalid_elements_alike_and_say_what_it_means(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert (
        run(["fit", "@onera_m6:9x9x7", "--order", "4", "--method", "least_squares", "-o", "m6.h5", "--json", "f.json"])
        == 0
    )
    fitted = " ".join("".join(capsys.readouterr()).split())
    command = ["move", "m6.h5", "--deform", "translate=0/1e-9/0", "--mover", "held", "--allow-invalid"]
    assert run([*command, "-o", "moved.xyz", "--overwrite", "--json", "m.json"]) == 0
    moved = " ".join("".join(capsys.readouterr()).split())
    n, found = numbers("f.json")["n_invalid_control_elements"], numbers("m.json")
    assert n > 0
    assert found["n_invalid_before"] == n
    assert [(step["n_invalid"], step["n_tangled"]) for step in found["increments"]] == [(n, 0)]
    assert f"{n} of {found['n_elements']} elements of the control mesh invalid" in fitted
    assert f"{n} of {found['n_elements']} elements invalid before, {n} after, 0 of these new" in moved
    assert all("an element is invalid where" in text for text in (fitted, moved))


def test_a_plane_that_is_fixed_beside_the_surface_is_named_as_the_cause(strip, capsys):
    reason = "on patch 'sides', which is fixed where the surface ends on it"
    cure = "tried, and no cell is inverted: no --fix si*"
    fails_as_expected([*strip[:-1], "pitch=20deg", "--fix", "si*"], capsys, "cells inverted", reason, cure)
    assert run([*strip[:-1], "pitch=20deg"]) == 0
    assert run([*strip, "--slide", "si*"]) == 0
    assert numbers("m.json")["after"]["n_inverted"] == 0
    assert run([*strip, "--release", "sides"]) == 0
    assert numbers("m.json")["after"]["n_inverted"] == 0
    fails_as_expected([*strip, "--slide", "rim"], capsys, "patch rim is to slide, but leaves its plane", "release it")
    fails_as_expected([*strip, "--slide", "sides", "--fix", "sides"], capsys, "both fixed and sliding")


def test_curved_faces_that_follow_are_told(workplace, capsys):
    fit_grid(flare_grid()).save("floor.h5")
    assert run(move("--deform", "translate=0/1e-3/1e-3", "--fix", "side*")) == 0
    assert numbers("m.json")["following"] == ["patch 'cone'"]
    told = " ".join("".join(capsys.readouterr()).split())
    assert "curved faces, which follow it unless they are fixed (--fix): patch 'cone'" in told
    assert run(move("--deform", "translate=0/1e-3/1e-3", "--fix", "side*", "--fix", "cone", "--allow-invalid")) == 0
    assert "follow it" not in "".join(capsys.readouterr())


def test_a_move_that_inverts_cells_is_refused_and_writes_nothing(workplace, capsys):
    arguments = move("--deform", "translate=0/0/0.6", "--mover", "held")
    Path("moved.xyz").write_text("precious")
    fails_as_expected(arguments, capsys, "cells inverted", "cell (", "of block", "increment 1 of 1", "--allow-invalid")
    assert Path("moved.xyz").read_text() == "precious"
    assert sorted(os.listdir()) == ["floor.h5", "moved.xyz"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "options", "cause", "cure"),
    [
        (
            "least_squares",
            ["--mover", "elasticity", "--increments", "1"],
            "of 1,200 elements of the control mesh invalid before the move",
            "--method valid",
        ),
        (
            "valid",
            ["--mover", "idw"],
            "tangles in increment 1 of 1, element (",
            "tried, and no cell is inverted: --mover elasticity --increments 10",
        ),
        (
            "valid",
            ["--mover", "elasticity", "--increments", "1"],
            "tangles in increment 1 of 1, element (",
            "tried, and no cell is inverted: --increments 10",
        ),
    ],
)
def test_a_refused_move_names_a_cause_and_the_cure_works(tmp_path, monkeypatch, capsys, method, options, cause, cure):
    monkeypatch.chdir(tmp_path)
    fit = ["fit", "@onera_m6:9x9x7", "--n-control", "6x6x5", "-o", "wing.h5", "--overwrite", "--method"]
    command = ["move", "wing.h5", "--deform", "twist=60deg", "-o", "moved.xyz", "--overwrite"]
    assert run([*fit, method]) == 0
    fails_as_expected([*command, *options], capsys, "cells inverted, the worst cell (", cause, cure)
    assert method == "valid" or run([*fit, "valid"]) == 0
    assert run([*command, "--mover", "elasticity", "--increments", "10"]) == 0


def test_a_move_that_the_residual_folds_is_reported_from_one_that_the_splines_do(model):
    mesh = moving_mesh(model)
    movement = LinearElasticity(mesh).move(model.control_points, model.control_points[mesh.surface_ids] + 1e-3)
    own = model.evaluator().forward(movement.points)
    folded = model.header.grid(model.topology.shapes, own.copy())
    folded.blocks[1].nodes[3, 3, 3] = folded.blocks[1].nodes[5, 5, 5]
    quality = GridQuality.of_baseline(model.regenerate())
    nodes = folded.to_vector().reshape(-1, 3)
    cells = inverted_cells(quality, quality.cells(nodes), newly=True)
    moved = SimpleNamespace(mesh=mesh, movement=movement, grid=folded, newly_inverted=cells)
    moved.after = report_quality(quality, nodes)
    assert cells
    text = complaint(model, moved, [Trial("--comoving", 3)])
    assert "the splines' own grid is valid there, what they miss of the grid, up to " in text
    assert "is in the way; not tried here: more control points (fit --n-control)" in text
    assert "nothing that was tried helps: --comoving (3 cells); deform it less" in text
    assert f"(by the width of the cells {model.report.worst_local})" in text
    moved.mesh = SimpleNamespace(n_invalid=3, elements=range(7))
    fitted = {
        name: replace(model, settings=replace(model.settings, method=name)) for name in ("valid", "least_squares")
    }
    cures = {name: complaint(one, moved, []) for name, one in fitted.items()}
    assert "before the move; not tried here: fewer control points (fit --n-control);" in cures["valid"]
    assert "--method valid" not in cures["valid"]
    assert "(fit --method valid);" in cures["least_squares"]
    moved.mesh = mesh
    bare = replace(model, residual=None)
    assert "the splines fold between control points" in complaint(bare, moved, [])


def test_a_grid_with_inverted_cells_is_written_where_that_is_wanted(workplace, capsys):
    assert run(move("--deform", "translate=0/0/0.6", "--mover", "held", "--allow-invalid")) == 0
    found = numbers("m.json")
    assert found["newly_inverted"][0]["corner"] == found["after"]["min_corner"]
    assert found["after"]["min_corner"] < 0.0
    assert f"warning: {found['after']['n_inverted']:,} inverted cells now" in "".join(capsys.readouterr())


@pytest.mark.slow
def test_patches_choose_what_moves_and_what_is_held(workplace, capsys):
    fit_grid(flat_plate_grid((7, 7, 7))).save("plate.h5")
    command = [
        "move",
        "plate.h5",
        "--deform",
        "translate=0/0.01/0",
        "-o",
        "moved.xyz",
        "--overwrite",
        "--json",
        "m.json",
    ]
    counts = {}
    for design in ("wing*", "wing_upper"):
        assert run([*command, "--mover", "held", "--allow-invalid", "--design", design, "--pin", "symmetry"]) == 0
        counts[design] = numbers("m.json")["n_surface_control_points"]
    mesh = moving_mesh(FittedModel.load("plate.h5"), design="wing_upper")
    assert counts == {"wing*": counts["wing*"], "wing_upper": len(mesh.surface_ids)}
    assert counts["wing_upper"] < counts["wing*"]
    fails_as_expected([*command, "--design", "wings*"], capsys, "no patch is called 'wings*'", "wing_lower")
    fails_as_expected([*command, "--pin", "roof"], capsys, "no patch is called 'roof'")


def test_increments_are_shown_on_a_terminal(workplace, monkeypatch):
    seen = []
    monkeypatch.setattr(progress, "is_terminal", lambda: True)
    monkeypatch.setattr(progress._Bar, "_draw", lambda bar, what: seen.append((bar.fraction, what)))
    assert run(move(*FLOOR, "--mover", "elasticity", "--increments", "3")) == 0
    named = [what for _, what in seen if "increment " in what]
    assert named == [f"moving the control mesh: increment {n} of 3" for n in (1, 2, 3)]
    fractions = [fraction for fraction, what in seen if what]
    assert fractions == sorted(fractions)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--deform", "twust=3"], ["twust", "twist"]),
        (["--deform", "none.csv"], ["none.csv"]),
        ([], ["--deform"]),
        ([*FLOOR, "--mover", "jelly"], ["--mover jelly", "elasticity", "held"]),
        ([*FLOOR, "--mover", "held", "--nu", "0.1"], ["--nu", "held"]),
        ([*FLOOR, "--mover", "elasticity", "--nu", "0.5"], ["Poisson", "0.5"]),
        ([*FLOOR, "--stiffness", "iron"], ["--stiffness iron", "orthogonality"]),
        ([*FLOOR, "--solver", "abacus"], ["--solver abacus", "cholesky"]),
        ([*FLOOR, "--increments", "0"], ["--increments"]),
        ([*FLOOR, "--increments", "3"], ["--increments", "'rotations' has no such setting", "--mover elasticity"]),
        ([*FLOOR, "--surface", "moved.xyz"], ["moved.xyz", "twice"]),
        ([*FLOOR, "--surface", "floor.h5/new.csv"], ["floor.h5/new.csv", "no folder"]),
    ],
)
def test_what_is_wrong_is_said_in_one_line(workplace, capsys, arguments, words):
    fails_as_expected(move(*arguments), capsys, *words)
    assert os.listdir() == ["floor.h5"]


def test_a_grid_without_patches_is_reported_how_to_get_them(workplace, capsys):
    small_model().save("bare.h5")
    command = ["move", "bare.h5", *FLOOR, "-o", "moved.xyz"]
    fails_as_expected(command, capsys, "bare.h5", "no patches", "inspect GRID --draft", "--patches")


def test_the_file_of_points_is_not_replaced(workplace, capsys):
    assert run(move(*FLOOR, "--surface", "new.csv", "--mover", "transfinite")) == 0
    fails_as_expected(move("--deform", "new.csv", "--surface", "new.csv"), capsys, "new.csv", "is read by this command")


BUMPS = [
    "move",
    "passage.h5",
    "--deform",
    "bumps=0.03,seed=1,wavelength=2",
    "-o",
    "m.xyz",
    "--overwrite",
    "--json",
    "m.json",
]


def gap_of_passage(nodes):
    """How far the sides of a moved passage are apart (m)."""
    cos, sin = np.cos(PITCH), np.sin(PITCH)
    rotation = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    return np.linalg.norm(nodes[:, 0] @ rotation.T - nodes[:, -1], axis=-1).max()


def test_periodic_sides_move_alike_and_a_deformation_that_differs_there_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_grid(tmp_path / "passage.xyz", passage())
    hub = '[[patch]]\nname = "hub"\nkind = "wall"\nfaces = [{block = 1, face = "kmin"}]\n'
    (tmp_path / "patches.toml").write_text(hub, encoding="utf-8")
    assert run(["fit", "passage.xyz", "--patches", "patches.toml", "-o", "passage.h5", "--json", "f.json"]) == 0
    told = " ".join("".join(capsys.readouterr()).split())
    sides = "block 1 jmin and block 1 jmax"
    assert f"control points of {sides} move alike: a rotation about x by 17.1887 deg maps one onto the other" in told
    (pair,) = numbers("f.json")["periodic"]
    assert pair == {"markers": ["block 1 jmin", "block 1 jmax"], "motion": "rotation about x by 17.1887 deg"}
    assert run(BUMPS) == 0
    told, found = " ".join("".join(capsys.readouterr()).split()), numbers("m.json")
    moved, size = read_grid("m.xyz").blocks[0].nodes, 5.0
    assert gap_of_passage(moved) < 1e-14 * size
    assert np.abs(moved - passage().blocks[0].nodes)[:, 0, 1:-1].max() > 1e-3
    assert found["periodic_gaps"] == []
    ((gap,), ends) = found["periodic"], ("gap", "gap_before")
    assert all(gap[end] < 1e-14 * size for end in ends)
    assert f"copies of nodes of {sides}, a rotation about x by 17.1887 deg, are off by up to" in told
    assert re.search(r"the deformation differs there by up to [\d.e-]+ m, at block 1 \(\d, 8, 1\): the mean is", told)
    assert run(["quality", "passage.h5", "--json", "q.json"]) == 0
    assert numbers("q.json")["periodic"] == [{**pair, "gap": gap["gap_before"]}]
    assert run(["quality", "m.xyz", "--patches", "patches.toml", "--baseline", "passage.h5", "--json", "q.json"]) == 0
    assert numbers("q.json")["periodic"] == [gap]
    assert f"copies of nodes of {sides}" in " ".join("".join(capsys.readouterr()).split())
    assert run([*BUMPS[:3], "stretch=1.1", *BUMPS[4:]]) == 0
    assert "the deformation differs there" not in "".join(capsys.readouterr())


def test_periodic_sides_that_are_not_tied_and_that_a_move_takes_apart_are_named_with_the_gap(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    fit_grid(passage(), topology=untied(find_topology(passage()))).save("passage.h5")
    assert run(BUMPS) == 0
    (gap,) = numbers("m.json")["periodic_gaps"]
    apart = gap_of_passage(read_grid("m.xyz").blocks[0].nodes)
    assert gap["gap"] == pytest.approx(apart, rel=1e-6)
    assert apart > 1e-3
    told = " ".join("".join(capsys.readouterr()).split())
    assert f"are {apart:.3g} m apart" in told
    assert run(["move", "passage.h5", "--deform", "twist=0deg", "-o", "n.xyz", "--json", "n.json"]) == 0
    assert numbers("n.json")["periodic_gaps"] == []
    (pair,) = numbers("n.json")["periodic"]
    assert pair["markers"] == ["block 1 jmin", "block 1 jmax"]
    assert max(pair["gap"], pair["gap_before"]) < 1e-12


def test_nodes_of_a_curved_patch_that_is_to_slide_stay_on_its_surface(workplace, capsys):
    fit_grid(flare_grid()).save("floor.h5")
    assert run(move("--deform", "translate=0/1e-3/1e-3", "--fix", "side*", "--slide", "cone")) == 0
    found = numbers("m.json")
    assert found["following"] == []
    assert [slide["patch"] for slide in found["sliding"]] == ["patch 'cone'"]
    assert 0.0 <= found["sliding_off"] < 1e-13
    told = " ".join(capsys.readouterr().out.split())
    assert re.search(r"nodes of patch 'cone' slide on a cone of half angle [\d.]+ deg with its apex at \(", told)
    assert "they leave their places over these surfaces by" in told
    before, after = (grid.blocks[0].nodes[-1].reshape(-1, 3) for grid in (flare_grid(), read_grid("moved.xyz")))
    (slide,) = moving_mesh(FittedModel.load("floor.h5"), fixed="side*", sliding="cone").curved_slides
    assert slide.surface.distances(after).max() < 1e-13
    assert np.linalg.norm(after - before, axis=1).max() > 1e-3
