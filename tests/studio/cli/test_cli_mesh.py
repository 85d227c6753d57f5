"""The commands ``fit`` and ``move`` of meshes without structure: from the file of a mesh to its moved file."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from mesh_cases import mesh_around_two_sections, periodic_mesh, sector_mesh
from riding_cases import mesh, plane_su2_text, su2_text
from test_cli import fails_as_expected, numbers

from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.files import read_mesh
from bspline_mdao.meshes import LatticeSettings, fit_mesh
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.cli.mesh_fit import other_lattice, untied_lines

KINDS = '[kinds]\n"wing" = "wall"\n"far*" = "farfield"\n"sym*" = "symmetry"\n'


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wing.su2").write_text(su2_text(mesh()) + "% the last line stays\n")
    return tmp_path


def lines_but_nodes(text: str) -> list[str]:
    """Lines of an SU2 file without those that have three coordinates."""
    return [line for line in text.splitlines() if len(re.findall(r"\d\.\d", line)) != 3]


def test_two_commands_lead_from_a_mesh_to_a_moved_mesh(workplace, capsys):
    assert run(["fit", "wing.su2", "-o", "wing.h5", "--json", "fit.json"]) == 0
    fitted, text = numbers("fit.json"), capsys.readouterr().out
    assert [marker["kind"] for marker in fitted["markers"] if marker["name"] == "wing"] == ["wall"]
    assert fitted["n_nodes"] == mesh().n_points
    for words in ("lattice of", "nodes on walls", "wing.h5 written"):
        assert words in text.replace("node on", "nodes on")
    written = ["-o", "moved.su2", "--surface", "surface.csv", "--json", "move.json"]
    assert run(["move", "wing.h5", "--deform", "twist=5deg", *written]) == 0
    moved, text = numbers("move.json"), capsys.readouterr().out
    assert moved["n_inverted"] == {"before": 0, "after": 0}
    assert {part["status"] for part in moved["certificate"]["splines"]} == {"valid"}
    cells = {part["block"]: (part["n"], part["n_invalid"]) for part in moved["certificate"]["cells"]}
    assert cells == {"hexahedron": (7763, 0), "pyramid": (3318, 4)}  # the four are folded before the move as well
    assert "11,077 of 11,081 cells valid: their Jacobian is proved positive" in text
    assert "lattice elements valid: their Jacobian is proved positive everywhere between neighbouring knots" in text
    assert "inverted cells" in text
    before, after = ((workplace / name).read_text() for name in ("wing.su2", "moved.su2"))
    assert lines_but_nodes(before) == lines_but_nodes(after)
    shift = np.linalg.norm(read_mesh("moved.su2").mesh.points - mesh().points, axis=1)
    assert shift.max() == pytest.approx(moved["largest_displacement"], rel=1e-12)
    assert shift.max() > 0.01
    again = ["move", "wing.h5", "--deform", "surface.csv", "-o", "again.su2", "--no-certify", "--json", "b.json"]
    assert run(again) == 0
    assert numbers("b.json")["certificate"] is None
    np.testing.assert_allclose(read_mesh("again.su2").mesh.points, read_mesh("moved.su2").mesh.points, atol=1e-12)


def test_a_model_comes_back_from_its_file_with_the_same_bits(workplace):
    assert run(["fit", "wing.su2", "-o", "wing.h5", "--spacing", "0.3"]) == 0
    model = MeshModel.load("wing.h5")
    assert model.settings.spacing == 0.3
    model.save("again.h5")
    again = MeshModel.load("again.h5")
    assert again.checksum == model.checksum
    np.testing.assert_array_equal(again.control_points, model.control_points)
    np.testing.assert_array_equal(again.mesh.points, mesh().points)


def test_a_lattice_is_refined_for_moves_that_are_to_come(workplace, capsys):
    assert run(["fit", "wing.su2", "-o", "wing.h5", "--spans", "3", "--json", "coarse.json"]) == 0
    asked = ["--for", "bumps=0.2", "--for", "twist=1deg"]
    assert run(["fit", "wing.su2", "-o", "fine.h5", "--spans", "3", *asked, "--json", "fine.json"]) == 0
    assert "refined for moves" in capsys.readouterr().out
    assert np.prod(numbers("fine.json")["lattice"]) > np.prod(numbers("coarse.json")["lattice"])
    assert list(MeshModel.load("fine.h5").lattice.shape) == numbers("fine.json")["lattice"]
    both = ["fit", "wing.su2", "-o", "both.h5", "--spans", "3", "--spacing", "0.1"]
    fails_as_expected(both, capsys, "give one of them")
    fails_as_expected(["fit", "@onera_m6", "--for", "twist=1deg", "-o", "b.h5"], capsys, "--for")


def test_a_fit_says_whether_the_moves_that_it_is_for_invert_cells(workplace, capsys):
    asked = ["--spans", "4", "--for", "twist=1deg", "--for", "sweep=60deg"]
    assert run(["fit", "wing.su2", "-o", "wing.h5", *asked, "--json", "fit.json"]) == 0
    out, err = capsys.readouterr()
    inverted = numbers("fit.json")["n_inverted_by_moves"]
    assert inverted["twist=1deg"] == 0 < inverted["sweep=60deg"]
    assert out.splitlines()[-1] == "tried twist=1deg: no cell of the mesh is inverted"
    assert f"sweep=60deg inverts {inverted['sweep=60deg']} cells of the mesh" in err.splitlines()[-1]
    assert err.splitlines()[-1].endswith("deform it less")
    model = fit_mesh("wing.su2", settings=LatticeSettings(spans=4))
    walls = model.deformed(parse_deformation(("sweep=60deg",), model, model.moving_mesh))
    assert inverted["sweep=60deg"] <= model.n_inverted(walls)


def test_settings_of_another_lattice_are_those_of_the_text_to_type():
    refined = LatticeSettings(refined=((0, 1.0, 2.0, 0.1),))
    assert other_lattice(refined, 0.5) == ("a model by 'fit --spans 5'", LatticeSettings(spans=5.0))
    by_width = "a model by 'fit --spacing 0.2'", LatticeSettings(spacing=0.2)
    assert other_lattice(replace(refined, spacing=0.1), 0.5) == by_width


def test_a_move_that_inverts_cells_refines_the_lattice_if_that_cures_it(workplace, capsys):
    mesh, _ = mesh_around_two_sections(0.03)
    n, faces = mesh.n_stored, mesh.markers or {}
    lines = ["NDIME= 2", f"NELEM= {mesh.n_cells}", *(f"5 {a} {b} {c}" for a, b, c in mesh.cells["wedge"][:, :3])]
    lines += [f"NPOIN= {n}", *(f"{x:.17g} {y:.17g}" for x, y in mesh.points[:n, :2]), f"NMARK= {len(faces)}"]
    for name, each in faces.items():
        lines += [f"MARKER_TAG= {name}", f"MARKER_ELEMS= {len(each)}", *(f"3 {a} {b}" for a, b in each[:, :2])]
    (workplace / "two.su2").write_text("\n".join(lines) + "\n")
    (workplace / "kinds.toml").write_text('[kinds]\nmain = "wall"\nflap = "wall"\nfar = "farfield"\n')
    fit = ["fit", "two.su2", "--patches", "kinds.toml", "-o"]
    assert run([*fit, "two.h5"]) == 0
    assert "less than a span of the lattice" not in "".join(capsys.readouterr())
    assert run([*fit, "coarse.h5", "--spacing", "0.1"]) == 0
    text = " ".join("".join(capsys.readouterr()).split())
    assert re.search(r"flap is 0\.0(29|30|31)\d* m from main at .*, less than a span of the lattice, 0\.0\d+ m", text)
    move = [
        "--design",
        "flap",
        "--deform",
        "translate=0.08/-0.02/0",
        "-o",
        "moved.su2",
        "--overwrite",
        "--json",
        "move.json",
    ]
    assert run(["move", "coarse.h5", *move]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("the move inverts cells; trying the lattice refined for it\n")
    assert "refined for this move" in shown
    assert numbers("move.json")["n_inverted_before_refining"] > 10
    assert numbers("move.json")["n_inverted"]["after"] == 0
    assert run(["move", "two.h5", *move]) == 0
    assert numbers("move.json")["n_inverted_before_refining"] == 0


def test_a_move_that_moves_nothing_is_warned_of_for_a_mesh_as_for_a_grid(workplace, capsys):
    assert run(["fit", "wing.su2", "-o", "mesh.h5"]) == 0
    assert run(["fit", "@flat_plate:9x8x7", "-o", "grid.h5"]) == 0
    in_millimetres = "rotate=10deg@hinge(700,0,0 -> 700,0,1000),blend=50"
    for number, deformation in enumerate(("translate=0/0/0", in_millimetres, "translate=1e-6/0/0")):
        for model, name in (("mesh.h5", f"{number}.su2"), ("grid.h5", f"{number}.xyz")):
            capsys.readouterr()
            assert run(["move", model, "--deform", deformation, "-o", name]) == 0
            said = "warning: the deformation moves no point of the design surface" in capsys.readouterr().err
            assert said == (number < 2), (deformation, model)


@pytest.mark.parametrize(
    ("fitted", "options", "warned", "is_refused"),
    [
        ("@flat_plate:9x8x7", ["--deform", "translate=0/0/0.3", "--mover", "held"], "out of their plane of symm", True),
        ("plane.su2", ["--deform", "bumps=0.2,seed=1,wavelength=0.1+twist=1deg"], "the walls are a section", True),
        ("@flat_plate:9x8x7", ["--deform", "translate=0/0/0.01"], "out of their plane of symmetry", False),
        ("plane.su2", ["--deform", "twist=1deg"], "the walls are a section", False),
    ],
)
def test_remarks_on_a_deformation_are_said_once_and_before_the_first_move(
    workplace, monkeypatch, capsys, fitted, options, warned, is_refused
):
    (workplace / "plane.su2").write_text(plane_su2_text())
    assert run(["fit", fitted, "-o", "model.h5"]) == 0
    capsys.readouterr()
    monkeypatch.setattr("sys.stdout", sys.stderr)  # the order of lines in both
    suffix = ".su2" if fitted.endswith(".su2") else ".xyz"
    assert run(["move", "model.h5", *options, "-o", f"moved{suffix}"]) == (2 if is_refused else 0)
    first, *rest = capsys.readouterr().err.splitlines()
    assert first.startswith("warning: ")
    assert warned in first
    assert warned not in "".join(rest)
    assert any("inverts cells; trying" in line for line in rest) == is_refused


def test_both_planes_of_a_mesh_of_two_dimensions_move_alike(workplace, capsys):
    (workplace / "plane.su2").write_text(plane_su2_text())
    (workplace / "kinds.toml").write_text('[kinds]\n"*" = "farfield"\n"wall*" = "wall"\n"airfoil*" = "wall"\n')
    arguments = ["fit", "plane.su2", "-o", "plane.h5"]
    assert run(arguments) == 0
    for deform in ("pitch=3deg", "bumps=0.001"):
        assert run(["move", "plane.h5", "--deform", deform, "-o", "moved.su2", "--overwrite"]) == 0
    printed = "".join(capsys.readouterr())
    assert "smallest area (m^2)" in printed
    assert "70 faces of the boundary have no marker, and move along" in printed
    assert run(["move", "plane.h5", "--deform", "twist=3deg", "-o", "moved.su2", "--overwrite"]) == 0
    printed = capsys.readouterr().err
    assert "a section, the same along the span, and 'twist' would change it along the span; 'pitch' turns" in printed
    assert "periodic" not in printed
    crushed = ["move", "plane.h5", "--deform", "bumps=0.5", "-o", "moved.su2", "--overwrite"]
    fails_as_expected(crushed, capsys, r", 0), of area -")


def test_lengths_are_shown_in_the_unit_that_is_said(workplace, capsys):
    assert run(["fit", "wing.su2", "-o", "wing.h5", "--units", "mm", "--json", "fit.json"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "unit of length: mm" in shown
    assert re.search(r"narrowest spans [\d.e-]+ mm wide", shown)
    assert numbers("fit.json")["units"] == "mm"
    model = MeshModel.load("wing.h5")
    assert (model.mesh.unit, model.checksum) == ("mm", fit_mesh("wing.su2", units="mm").checksum)
    assert run(["move", "wing.h5", "--deform", "twist=5deg", "-o", "moved.su2"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert re.search(r"moved by up to [\d.e-]+ mm", shown)
    assert "smallest volume (mm^3)" in shown
    assert not re.search(r"\d m\b", shown)


def test_sides_that_stay_are_copies_by_another_shift_or_no_copies():
    mesh, kinds = periodic_mesh(lean=0.0)
    sheared = replace(mesh, points=mesh.points @ [[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]], unit="ft")
    model = MeshModel.of(sheared, {**kinds, "in": "periodic", "out": "periodic"}, LatticeSettings(spacing=0.3))
    (line,) = untied_lines(model, set())
    assert line.startswith(
        "nodes of in and out stay: they are copies by a translation by (3.5, 0, 0) ft, which is along no dir"
    )
    model = MeshModel.of(*periodic_mesh(twist=0.1), LatticeSettings(spacing=0.3))
    assert untied_lines(model, set()) == [
        "nodes of per_1, per_2 stay: no shift and no rotation maps these sides onto each other"
    ]


def test_a_study_of_a_sector_designs_what_is_between_hub_and_casing_whatever_its_sides_are_called(workplace, capsys):
    text = su2_text(sector_mesh()[0])
    for name, other in (("per_1", "left"), ("per_2", "right"), ("floor", "hub"), ("top", "casing")):
        text = text.replace(name, other)
    (workplace / "sector.su2").write_text(text)
    assert run(["init", "sector.su2", "-o", "study.toml"]) == 0
    lines = (workplace / "study.toml").read_text().splitlines()
    assert next(line for line in lines if "design =" in line).split("#")[0].strip() == 'design = ["body"]'


def test_sides_by_a_rotation_are_tied_and_their_gap_is_told(workplace, capsys):
    sector, _ = sector_mesh()
    (workplace / "sector.su2").write_text(su2_text(sector))
    (workplace / "kinds.toml").write_text('[kinds]\nfloor = "wall"\n')
    assert run(["fit", "sector.su2", "--patches", "kinds.toml", "-o", "sector.h5", "--json", "fit.json"]) == 0
    shown = " ".join("".join(capsys.readouterr()).split())
    assert "control points along the axis, the radius and the angle" in shown
    assert "nodes of per_1 and per_2 move alike: a rotation about the direction (0.872872, -0.436436," in shown
    (fitted,) = numbers("fit.json")["periodic"]
    assert fitted["markers"] == ["per_1", "per_2"]
    assert fitted["gap"] < 1e-14
    move = ["move", "sector.h5", "--deform", "translate=0.02/0.01/-0.01", "-o", "moved.su2", "--overwrite"]
    assert run([*move, "--design", "body", "--json", "move.json"]) == 0
    shown = " ".join("".join(capsys.readouterr()).split())
    assert re.search(r"copies of nodes of per_1 and per_2, a rotation .* by 28\.6479 deg, are off by up to \d", shown)
    assert "walls end on both periodic sides" not in shown
    (moved,) = numbers("move.json")["periodic"]
    assert max(moved["gap"], moved["gap_before"]) < 1e-14
    quality = ["quality", "moved.su2", "--patches", "kinds.toml", "--baseline", "sector.su2"]
    assert run([*quality, "--json", "quality.json"]) == 0
    assert "are off by up to" in " ".join("".join(capsys.readouterr()).split())
    (measured,) = numbers("quality.json")["periodic"]
    assert measured["gap"] == pytest.approx(moved["gap"], abs=1e-14)
    assert run(move) == 0
    shown = " ".join("".join(capsys.readouterr()).split())
    assert re.search(r"differs there by up to 0\.0\d+ m, at node \d+ of marker 'floor', which moves as its copy", shown)


def test_kinds_that_contradict_sure_guesses_are_warned_of_in_one_line(workplace, capsys):
    kinds, commands = workplace / "kinds.toml", (["inspect", "wing.su2"], ["fit", "wing.su2", "-o", "a.h5"])
    kinds.write_text('[kinds]\nwing = "wall"\nsymmetry = "farfield"\nfar = "symmetry"\n')
    said = (
        "warning: kinds.toml: 'symmetry' is declared farfield and seems to be symmetry (by its name), 'far' is "
        "declared symmetry and seems to be farfield (by its name); mend the file unless that is meant"
    )
    for command in commands:
        assert run([*command, "--patches", "kinds.toml"]) == 0
        assert [line for line in capsys.readouterr().err.splitlines() if "is declared" in line] == [said]
    kinds.write_text(KINDS)
    for command in commands:
        assert run([*command, "--patches", "kinds.toml", *(["--overwrite"] if command[0] == "fit" else [])]) == 0
        assert "is declared" not in capsys.readouterr().err


def test_what_cannot_be_fitted_or_moved_ends_in_one_line(workplace, capsys):
    nameless = re.sub("MARKER_TAG= *wing", "MARKER_TAG= x_p", su2_text(mesh()))
    (workplace / "nameless.su2").write_text(nameless)
    (workplace / "kinds.toml").write_text('[kinds]\n"x_p" = "farfield"\n')
    fails_as_expected(["fit", "nameless.su2", "--patches", "kinds.toml", "-o", "a.h5"], capsys, "wall")
    assert run(["fit", "wing.su2", "-o", "wing.h5"]) == 0
    move = ["move", "wing.h5", "--deform", "twist=5deg", "-o"]
    fails_as_expected([*move, "moved.vtu"], capsys, "written as it is read")
    fails_as_expected([*move, "moved.su2", "--mover", "elasticity"], capsys, "leave out --mover")
    fails_as_expected(["refine", "wing.h5", "-o", "fine.xyz"], capsys, "is the model of a lattice around a mesh")
    for command in ("inspect", "quality"):
        fails_as_expected([command, "wing.h5"], capsys, "MeshModel.load in Python, and give its mesh ", "wing.su2 to")
    fails_as_expected([*move, "wing.su2"], capsys, "wing.su2")
    fails_as_expected([*move, "moved.su2", "--surface", "wing.step"], capsys, "leave out --surface wing.step")
    fails_as_expected([*move, "moved.su2", "--design", "tail"], capsys, "no marker is called 'tail'")
    fails_as_expected(["fit", "@onera_m6", "--spacing", "1", "-o", "b.h5"], capsys, "--spacing")
    changed = su2_text(replace(mesh(), points=1.01 * mesh().points))
    (workplace / "wing.su2").write_text(changed)
    fails_as_expected([*move, "moved.su2"], capsys, "has changed since")
    (workplace / "wing.su2").unlink()
    fails_as_expected([*move, "moved.su2"], capsys, "is not there")
    content = bytearray((workplace / "wing.h5").read_bytes())
    content[len(content) // 2] ^= 0xFF
    (workplace / "wing.h5").write_bytes(bytes(content))
    fails_as_expected([*move, "moved.su2"], capsys, "wing.h5")
    assert not (workplace / "moved.su2").exists()
