"""Drafted studies compare designs at one lift, and leave to the angle of attack what it does."""

from dataclasses import replace

import openmdao.api as om
import pytest
from study_cases import study_of

from bspline_mdao import DesignSurface, InputError, LatticeFlow, fit_grid
from bspline_mdao.core.design.deformation_warnings import stream_warnings
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.movers import moving_mesh
from bspline_mdao.studio.study import draft_body
from bspline_mdao.studio.study.draft import study_draft
from bspline_mdao.studio.study.draft_body import GridBody


@pytest.fixture(scope="module")
def grid():
    return onera_m6_grid((7, 7, 5))


def drafted(folder, grid):
    return study_of(folder, study_draft("@onera_m6:7x7x5", None, GridBody(grid, find_topology(grid))))


@pytest.mark.slow
def test_a_lattice_is_drafted_at_the_lift_that_it_has_about_the_baseline(grid, tmp_path):
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    study = drafted(tmp_path, grid)
    model = fit_grid(grid)
    problem = om.Problem(
        LatticeFlow(model=model, reference_area=DesignSurface.of(model).planform_area, axes=study.flow["axes"]),
        reports=None,
    ).setup()
    for name in ("alpha", "Mach_number"):
        problem.set_val(name, study.flow[name])
    problem.run_model()
    assert study.constraints["CL"]["equals"] == pytest.approx(problem.get_val("CL").item(), rel=1e-5)
    assert study.variables["twist"]["values"] == list(range(2, study.variables["twist"]["stations"] + 1))
    assert study.variables["alpha"]["lower"] < study.flow["alpha"] < study.variables["alpha"]["upper"]


def test_euler_flow_is_drafted_with_trim(grid, tmp_path, monkeypatch):
    def camberless(*_):
        raise InputError("camber surface: the section at the tip has two upper sides")

    monkeypatch.setattr(draft_body, "lattice_camber", camberless)
    study = drafted(tmp_path, grid)
    assert (study.flow["kind"], study.flow["trim"]) == ("euler", True)
    assert study.flow["CL_target"] == pytest.approx(0.22, abs=0.03)
    assert list(study.variables) == ["twist"]
    assert study.variables["twist"]["values"] == list(range(2, study.variables["twist"]["stations"] + 1))
    assert "CL" not in study.constraints


def test_a_draft_names_the_mean_chord_for_moments(grid):
    text = study_draft("@onera_m6:7x7x5", None, GridBody(grid, find_topology(grid)))
    (line,) = [line for line in text.splitlines() if "reference_chord" in line]
    half, wing = 1.4844, DesignSurface.of(fit_grid(grid))  # half the span, in root chords
    assert float(line.split()[3]) == pytest.approx(wing.planform_area / half, rel=1e-3)


def test_a_draft_says_if_the_wing_seems_to_fly_backwards(grid):
    blocks = tuple(replace(block, nodes=block.nodes * [-1.0, -1.0, 1.0]) for block in grid.blocks)
    texts = [study_draft("wing.xyz", None, GridBody(g, find_topology(g))) for g in (grid, replace(grid, blocks=blocks))]
    said = "# the stream is taken to run along +x, and the downstream end of the sections is the blunt one:\n# turn the"
    assert [said in text for text in texts] == [False, True]
    model = fit_grid(replace(grid, blocks=blocks))
    (warning,) = stream_warnings(parse_deformation("twist=5", model, moving_mesh(model)), model)
    (line,) = [line for line in texts[1].splitlines() if "the blunt one" in line]
    assert warning.startswith(f"{line.removeprefix('# ').removesuffix(':')}; ")  # as move says


def test_without_openaerostruct_the_lift_is_an_estimate_to_be_set(grid, tmp_path, monkeypatch):
    monkeypatch.setattr(draft_body, "find_spec", lambda name: None)
    text = study_draft("@onera_m6:7x7x5", None, GridBody(grid, find_topology(grid)))
    assert "  # set yours: not computed, estimated for an elliptical load; with" in text
    assert study_of(tmp_path, text).constraints["CL"]["equals"] == pytest.approx(0.22, abs=0.03)
