"""RANS cases of OpenFOAM: they keep their Reynolds number, have what a model needs, and converge."""

import shutil

import numpy as np
import pytest

from bspline_mdao import InputError
from bspline_mdao.files import write_case
from bspline_mdao.flow import RansCase
from bspline_mdao.flow.openfoam.case_folder import CaseFolder
from bspline_mdao.flow.openfoam.solver_log import Convergence
from bspline_mdao.generators import naca_section, onera_m6_grid, section_o_grid

EAST = np.array([1.0, 0.0, 0.0])


def number_after(text, word):
    """The number behind a word."""
    return float(text.split(word)[1].split()[0].strip(";"))


@pytest.mark.parametrize("speed", [3.0, 70.0])
def test_the_reynolds_number_stays_when_the_speed_changes(speed):
    case = RansCase(2.5e6, length=0.7)
    fields, settings = case.files(case.stream(EAST, speed))
    nu = number_after(settings["constant/transportProperties"], "nu ")
    np.testing.assert_allclose(speed * 0.7 / nu, 2.5e6)
    np.testing.assert_allclose(fields["nuTilda"].value, 3.0 * nu)
    np.testing.assert_allclose(fields["U"].value, [speed, 0.0, 0.0])


def test_a_compressible_case_has_its_mach_and_reynolds_number():
    case = RansCase(4e6, length=0.5, compressible=True)
    stream = case.stream(EAST, 0.6)
    fields, settings = case.files(stream)
    temperature, pressure = fields["T"].value, fields["p"].value
    mu = number_after(settings["constant/thermophysicalProperties"], "mu ")
    density = pressure / (287.05 * temperature)
    np.testing.assert_allclose(stream.speed / np.sqrt(1.4 * 287.05 * temperature), 0.6)
    np.testing.assert_allclose(density * stream.speed * 0.5 / mu, 4e6)
    np.testing.assert_allclose(stream.dynamic_pressure, 0.5 * density * stream.speed**2)


def test_eddy_viscosity_of_the_sst_model_is_that_of_its_energy_and_rate():
    case = RansCase(1e6, turbulence="kOmegaSST")
    stream = case.stream(EAST, 12.0)
    fields, _ = case.files(stream)
    np.testing.assert_allclose(fields["k"].value / fields["omega"].value, fields["nut"].value)
    np.testing.assert_allclose(fields["nut"].value, 0.009 * case.viscosity(stream))


@pytest.mark.parametrize("compressible", [False, True], ids=["incompressible", "compressible"])
@pytest.mark.parametrize("walls", ["resolved", "functions"])
@pytest.mark.parametrize("turbulence", ["SpalartAllmaras", "kOmegaSST"])
def test_every_transported_variable_has_a_field_a_second_order_scheme_and_a_tolerance(turbulence, walls, compressible):
    case = RansCase(1e6, turbulence=turbulence, walls=walls, compressible=compressible)
    fields, settings = case.files(case.stream(EAST, 0.5))
    names = {"nuTilda"} if turbulence == "SpalartAllmaras" else {"k", "omega"}
    assert set(fields) - {"U", "p", "nut", "T", "alphat"} == names
    for name in names:
        assert f"div(phi,{name}) bounded Gauss limitedLinear 1;" in settings["system/fvSchemes"]
        assert settings["system/fvSolution"].count(name) == 3
    assert " upwind" not in settings["system/fvSchemes"]
    assert ("T" in fields) == ("alphat" in fields) == compressible


@pytest.mark.parametrize("compressible", [False, True], ids=["incompressible", "compressible"])
def test_the_tolerance_is_that_of_the_flow_and_a_tenth_of_that_of_turbulence(compressible):
    case = RansCase(1e6, tolerance=3e-7, compressible=compressible)
    control = case.files(case.stream(EAST, 0.5))[1]["system/fvSolution"].split("residualControl")[1].split("}")[0]
    flow = "(p|U|h)" if compressible else "(p|U)"
    assert control.split() == ["{", f'"{flow}"', "3e-07;", '"(nuTilda)"', "3e-06;"]


@pytest.mark.parametrize(
    ("planes", "grid"),
    [
        ("empty", lambda: section_o_grid(naca_section(), 8, n_away=4, far=5.0)),
        ("symmetry", lambda: onera_m6_grid((5, 6, 7))),
    ],
    ids=["section", "wing"],
)
def test_a_case_is_written_for_sections_and_wings(tmp_path, planes, grid):
    case = RansCase(6e6, planes=planes)
    write_case(tmp_path / "case", grid(), *case.files(case.stream(EAST, 30.0)), planes=planes)
    assert f"type {planes};" in (tmp_path / "case" / "constant" / "polyMesh" / "boundary").read_text()
    for name in ("U", "p", "nut", "nuTilda"):
        assert f"symmetry {{ type {planes}; }}" in (tmp_path / "case" / "0" / name).read_text()


def test_y_plus_is_expected_at_the_middles_of_first_cells():
    expected = RansCase(6e6, length=2.0).expected_y_plus([1e-5, 3e-5])
    friction = 0.027 / 6e6 ** (1.0 / 7.0)
    np.testing.assert_allclose(expected, np.array([0.5e-5, 1.5e-5]) * 3e6 * np.sqrt(0.5 * friction))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"reynolds_number": 0.0}, "reynolds_number 0.0; give a positive number"),
        ({"length": np.inf}, "length inf; give"),
        ({"turbulence": "kEpsilon"}, "turbulence 'kEpsilon'; give one of SpalartAllmaras, kOmegaSST"),
        ({"walls": "slip"}, "walls 'slip'; give one of resolved, functions"),
        ({"planes": "wall"}, "planes 'wall'; give one of"),
    ],
)
def test_what_makes_no_case_is_refused(options, words):
    with pytest.raises(InputError, match=words):
        RansCase(**{"reynolds_number": 1e6, **options})


def fly(folder, case, speed, off_wall):
    """Solve a flow about the NACA 0012 at no angle: how it converged, and y+ on the section."""
    fields, settings = case.files(case.stream(EAST, speed))
    settings["system/controlDict"] += (
        "functions { yPlus { type yPlus; libs (fieldFunctionObjects); writeControl onEnd; } }\n"
    )
    grid = section_o_grid(naca_section(), 64, far=15.0, n_away=44, off_wall=off_wall)
    run = CaseFolder(folder)
    with run.locked():
        write_case(folder, grid, fields, settings, planes="empty")
        log = run.solve(case.program, time_limit=120.0)
    return Convergence.of(case.program, log), number_after(log, "average = ")


@pytest.mark.parametrize(
    ("options", "speed", "off_wall"),
    [
        ({}, 30.0, 4e-5),
        ({"turbulence": "kOmegaSST"}, 30.0, 4e-5),
        ({"walls": "functions"}, 30.0, 2e-3),
        ({"compressible": True}, 0.5, 4e-5),
    ],
    ids=["Spalart and Allmaras", "SST", "wall functions", "compressible"],
)
@pytest.mark.solver
@pytest.mark.slow
@pytest.mark.skipif(shutil.which("simpleFoam") is None, reason="simpleFoam is not on the PATH")
def test_a_case_converges_with_the_y_plus_that_was_expected(tmp_path, options, speed, off_wall):
    case = RansCase(1e6, planes="empty", max_iterations=500, tolerance=1e-5, **options)
    convergence, y_plus = fly(tmp_path / "case", case, speed, off_wall)
    assert convergence.is_converged
    np.testing.assert_allclose(y_plus, case.expected_y_plus([off_wall])[0], rtol=0.15)
