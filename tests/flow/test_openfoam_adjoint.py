"""OpenFOAM's adjoint: what is written for it and what is read."""

import gzip
import re
import shutil

import numpy as np
import pytest
from openfoam_stand_ins import stand_in

from bspline_mdao.errors import InputError, SolverError
from bspline_mdao.files import CaseField, write_case
from bspline_mdao.flow.openfoam.adjoint import AdjointRun, FlowFunction
from bspline_mdao.generators import naca_section, section_o_grid

LAMINAR = "simulationType laminar;"
CD = FlowFunction.force("CD", ["wing"], [1.0, 0.0, 0.0], speed=2.0, area=0.5)
RUN = AdjointRun(["wing"], {"farfield": "farfield"}, tolerance=1e-7)

FOUND = """echo 'function : 0.25'
echo 'primal solution converged in 3 iterations'
echo 'function : 0.75'
echo 'adjoint solution converged in 10 iterations'
mkdir -p $2/10
"""


def written(folder, turbulence=LAMINAR):
    """A case of a section with a flow at time 7, and its points."""
    grid = section_o_grid(naca_section(0.12), n_around=16, far=5.0)
    conditions = {"symmetry": "type empty;", "other": "type zeroGradient;"}
    files = {"constant/turbulenceProperties": turbulence, "system/fvSchemes": "", "system/fvSolution": ""}
    fields = {
        "p": CaseField("[0 2 -2 0 0 0 0]", 1.5, conditions),
        "U": CaseField("[0 1 -1 0 0 0 0]", (3.0, 0.0, 0.0), conditions),
    }
    write_case(folder, grid, fields, files)
    shutil.copytree(folder / "0", folder / "7")
    text = (folder / "constant/polyMesh/points").read_text()
    return np.array(re.findall(r"\((\S+) (\S+) (\S+)\)", text), dtype=float)


def vectors(values):
    """A field of vectors as OpenFOAM writes it."""
    lines = "\n".join(f"({' '.join(map(repr, row))})" for row in values.tolist())
    return f"internalField nonuniform List<vector>\n{len(values)}\n(\n{lines}\n)\n;\nboundaryField {{ }}\n"


def stands_in(tmp_path, monkeypatch, points, script=FOUND):
    """The program, which finds derivatives that are numbered by the points."""
    gradient = np.random.default_rng(1).normal(size=points.shape)
    (tmp_path / "gradient").write_text(vectors(gradient))
    fields = " ".join(f"$2/0/{name}" for name in ("Ua", "pa", "U"))
    more = f"cp {tmp_path}/gradient $2/10/pointSensVecadjointESI; cp {fields} $2/10"
    stand_in(tmp_path / "bin", monkeypatch, "adjointOptimisationFoam", script + more)
    return gradient


def test_derivatives_value_and_iterations_are_those_of_the_program(tmp_path, monkeypatch):
    points = written(tmp_path / "case")
    gradient = stands_in(tmp_path, monkeypatch, points)
    found = RUN.solve(tmp_path / "case", tmp_path / "case/7", CD)
    assert np.array_equal(found.gradient, gradient)
    assert (found.value, found.n_flow, found.n_adjoint) == (0.75, 3, 7)


def test_a_mesh_whose_files_are_compressed_has_the_same_adjoint(tmp_path, monkeypatch):
    gradient = stands_in(tmp_path, monkeypatch, written(tmp_path / "case"))
    for name in ("boundary", "faces", "points"):
        file = tmp_path / "case/constant/polyMesh" / name
        file.with_name(f"{name}.gz").write_bytes(gzip.compress(file.read_bytes()))
        file.unlink()
    assert np.array_equal(RUN.solve(tmp_path / "case", tmp_path / "case/7", CD).gradient, gradient)


def test_the_derivative_by_the_velocity_is_that_of_the_fluxes_where_the_flow_comes_in(tmp_path, monkeypatch):
    points = written(tmp_path / "case")
    script = "sed -i 's/internalField uniform (0 0 0);/internalField uniform (1 -2 0);/' $2/0/Ua\n"
    script += "sed -i 's/internalField uniform 0;/internalField uniform 4;/' $2/0/pa\n"
    stands_in(tmp_path, monkeypatch, points, FOUND + script)
    found = RUN.solve(tmp_path / "case", tmp_path / "case/7", CD)
    # upstream half of a circle of 16 sides, one deep: its area as the flow (3 m/s) sees it is the distance of its ends
    ends = points[np.abs(np.hypot(points[:, 0] - 0.5, points[:, 1]) - 5.0) < 1.0]
    width = np.ptp(ends[:, 1])
    assert np.allclose(found.by_velocity, -width * (3.0 * np.array([1.0, -2.0, 0.0]) - 4.0 * np.array([1.0, 0, 0])))


def test_the_case_of_an_adjoint_has_the_flow_and_a_condition_for_every_patch(tmp_path, monkeypatch):
    stands_in(tmp_path, monkeypatch, written(tmp_path / "case"))
    RUN.solve(tmp_path / "case", tmp_path / "case/7", CD)
    place = tmp_path / "case/adjoint_CD"
    assert (place / "0/p").read_text() == (tmp_path / "case/7/p").read_text()
    for name, wall, far in (
        ("Ua", "adjointWallVelocity", "adjointFarFieldVelocity"),
        ("pa", "zeroGradient", "adjointFarFieldPressure"),
    ):
        text = (place / "0" / name).read_text()
        assert re.search(rf"wing {{ type {wall};", text)
        assert re.search(rf"farfield {{ type {far};", text)
    assert not (place / "0/nuaTilda").exists()
    entry = "function { weight 1; type force; patches (wing); direction (1.0 0.0 0.0); Aref 0.5; rhoInf 1; UInf 2.0; }"
    assert entry in (place / "system/optimisationDict").read_text()


def test_a_turbulent_flow_has_a_turbulent_adjoint(tmp_path, monkeypatch):
    turbulence = "simulationType RAS; RAS { RASModel SpalartAllmaras; turbulence on; }"
    stands_in(tmp_path, monkeypatch, written(tmp_path / "case", turbulence))
    RUN.solve(tmp_path / "case", tmp_path / "case/7", CD)
    place = tmp_path / "case/adjoint_CD"
    assert "adjointRASModel adjointSpalartAllmaras;" in (place / "constant/adjointRASProperties").read_text()
    assert re.search(r"farfield { type adjointFarFieldNuaTilda;", (place / "0/nuaTilda").read_text())


def test_an_adjoint_starts_from_the_last_one(tmp_path, monkeypatch):
    points = written(tmp_path / "case")
    stands_in(tmp_path, monkeypatch, points, FOUND + "sed -i 's/(0 0 0);/(4 5 6);/' $2/0/Ua\n")
    RUN.solve(tmp_path / "case", tmp_path / "case/7", CD)
    stands_in(tmp_path, monkeypatch, points)
    RUN.solve(tmp_path / "case", tmp_path / "case/7", CD)
    assert "internalField uniform (4 5 6);" in (tmp_path / "case/adjoint_CD/0/Ua").read_text()


def test_a_model_without_an_adjoint_and_an_opening_without_a_role_are_refused(tmp_path):
    written(tmp_path / "case", "simulationType RAS; RAS { RASModel kOmegaSST; }")
    with pytest.raises(InputError, match="no adjoint of the turbulence model 'kOmegaSST'; take SpalartAllmaras"):
        RUN.solve(tmp_path / "case", tmp_path / "case/7", CD)
    written(tmp_path / "other")
    with pytest.raises(InputError, match="whether patch 'farfield' is an inlet, an outlet or a far field; name it"):
        AdjointRun(["wing"], {}).solve(tmp_path / "other", tmp_path / "other/7", CD)
    with pytest.raises(InputError, match="'C/D' is no name of a function"):
        FlowFunction.force("C/D", ["wing"], [1.0, 0.0, 0.0], 1.0, 1.0)


@pytest.mark.parametrize(("gone", "what"), [("primal", "the flow"), ("adjoint", "the adjoint")])
def test_what_did_not_converge_is_said(gone, what, tmp_path, monkeypatch):
    points = written(tmp_path / "case")
    stands_in(tmp_path, monkeypatch, points, FOUND.replace(f"{gone} solution converged", "nothing"))
    with pytest.raises(SolverError, match=rf"{what} did not come below 1e-07 in 5000 iterations; allow more"):
        RUN.solve(tmp_path / "case", tmp_path / "case/7", CD)
