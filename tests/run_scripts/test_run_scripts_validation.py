"""The scripts of validation find what is known, within what their small sizes allow."""

import importlib
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from bspline_mdao import fit_grid
from bspline_mdao.generators import naca_section, section_o_grid

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


@pytest.mark.slow
def test_bodies_whose_flow_is_known_have_its_pressures_and_lift_and_no_drag(script, tmp_path):
    numbers = script("validation_exact").main(quick=True, figures=tmp_path)
    for body in numbers.values():
        assert max(member["residual"] for member in body["members"]) < 1e-8
        assert body["orders"]["CD"] > 1.9
        assert body["orders"]["CD_entropy"] > 1.9
    cylinder, sphere, section = (numbers[name]["members"][-1] for name in ("cylinder", "sphere", "section"))
    assert cylinder["Cp_min"] == pytest.approx(cylinder["Cp_min_exact"], rel=0.025)
    assert sphere["Cp_min"] == pytest.approx(sphere["Cp_min_exact"], rel=0.012)
    assert cylinder["CL"] == pytest.approx(0.0, abs=1e-7)
    assert sphere["CL"] == pytest.approx(0.0, abs=1e-7)
    assert numbers["cylinder"]["orders"]["Cp_error"] > 1.8
    assert section["CL_incompressible"] == pytest.approx(section["CL_exact"], rel=0.01)
    assert abs(section["CD"]) < 3e-3
    assert (tmp_path / "validation_exact.png").stat().st_size > 50_000


def test_exact_pressures_are_those_of_the_expansions(script):
    exact = script("validation_exact")
    series = 2.0 + 7 / 6 * 0.2**2 + 2.57833333 * 0.2**4  # largest speed on a cylinder
    assert exact.cylinder(0.0, 0.2) == pytest.approx(exact.pressure(series, 0.2), rel=1e-8)
    assert exact.cylinder(1.0, 0.2) == pytest.approx(exact.pressure(0.0, 0.2))
    assert exact.sphere(0.0, 0.2) == pytest.approx(-1.2712, abs=1e-4)
    z, speed, lift = exact.joukowski(np.linspace(0.0, 2.0 * np.pi, 20001)[1:-1])
    steps, cp = np.diff(z), 1.0 - 0.5 * (speed[1:] ** 2 + speed[:-1] ** 2)
    force = np.sum(1j * steps * cp) * np.exp(-1j * np.radians(exact.ALPHA))
    assert force == pytest.approx(1j * lift, abs=2e-6)


@pytest.mark.slow
def test_sections_of_two_families_approach_the_lift_published_and_no_drag(script, tmp_path, monkeypatch):
    monkeypatch.delenv("BSPLINE_MDAO_GRIDS", raising=False)
    numbers = script("validation_sections").main(quick=True, figures=tmp_path)
    for mach, within in (("M 0.5", 0.04), ("M 0.8", 0.06)):
        for family in ("O", "H-H"):
            members = numbers[mach][family]["members"]
            lift = numbers[mach]["CL_potential"] or numbers[mach]["CL_published"]
            gaps = [abs(member["CL"] / lift - 1.0) for member in members]
            assert max(member["residual"] for member in members) < 1e-8
            assert gaps[-1] < within
            assert gaps[-1] < gaps[0]
    for family in ("O", "H-H"):
        drags = [member["CD"] for member in numbers["M 0.5"][family]["members"]]
        assert np.log2(drags[0] / drags[-1]) / 2.0 > 1.9
        assert numbers["M 0.8"][family]["members"][-1]["CD"] == pytest.approx(0.0225, abs=0.002)
    assert (tmp_path / "validation_sections.png").stat().st_size > 50_000


def test_the_section_of_vassberg_and_jameson_closes(script):
    section = script("validation_sections").SECTION
    x, y = section.upper[-3:].T
    np.testing.assert_allclose(y, (1.0 - x) * 0.14188, rtol=1e-3, atol=1e-9)
    assert section.thickness == pytest.approx(0.12 / 1.00893, rel=1e-3)


def test_published_limits_are_those_of_the_published_values(script):
    sections = script("validation_sections")
    for (values, end), order in zip(sections.PUBLISHED.values(), (1.154, 0.278)):
        found = sections.limit(values[1:])
        assert (found["order"], found["limit"]) == (pytest.approx(order, abs=1e-3), pytest.approx(end, rel=1e-5))


@pytest.mark.slow
def test_m6_has_the_pressures_measured_and_the_lift_of_another_solver(script, tmp_path):
    m6 = script("validation_m6")
    file = tmp_path / "measured.dat"  # two orifices and their station, as in the file of CFL3D
    file.write_text(
        "   WING DATA\n    7    .84       3.06\nSPAN STATION 1 PRESSURES ETA=.44\n   11   23    .44\n"
        "  LOWER SURFACE (PORT, X/C, Cp)\n     1   .5750   -.230\n"
        "  UPPER SURFACE  (PORT, X/C, Cp)\n    12   .3500   -.582\n"
    )
    np.testing.assert_array_equal(m6.read_measured(file)[0.44], [[0.575, -0.23, -1.0], [0.35, -0.582, 1.0]])
    numbers = m6.main(quick=True, figures=tmp_path, measured=str(file))
    assert max(member["residual"] for member in numbers["members"]) < 1e-8
    assert numbers["members"][-1]["CL"] == pytest.approx(numbers["SU2"]["CL"], rel=0.1)
    assert numbers["Cp_difference"]["0.44"] < 0.1
    assert (tmp_path / "validation_m6.png").stat().st_size > 50_000


def test_a_negative_drag_has_a_minus_in_the_picture_of_adapted_grids(script, tmp_path, monkeypatch):
    model = fit_grid(section_o_grid(naca_section(0.12, extended=True), 16))
    grid, texts = model.regenerate(), []
    parts = np.full(len(grid.blocks[0].nodes[1:]) * (grid.shapes[0][1] - 1), 1e-5)
    estimates = {"CD": SimpleNamespace(contributions=parts, value=-1.3e-4)}
    found = SimpleNamespace(grid=grid, before=estimates, after=estimates)

    def save(canvas, file):
        canvas.draw_without_rendering()
        texts.extend(text.get_text() for text in canvas.findobj(Text))

    monkeypatch.setattr(Figure, "savefig", save)
    members = [{"n_cells": n**2, "CD": -0.1 / n} for n in (8, 16, 32)]
    script("adapt_grid").draw(tmp_path, model, found, members, members[1])
    assert "adapted: $C_D = -0.00013$" in texts
    outside = [re.sub(r"\$[^$]*\$", "", text) for text in texts]  # in formulas a hyphen is drawn as a minus
    assert not [text for text in outside if re.search(r"-\d", text)]


@pytest.mark.slow
def test_the_grid_of_a_section_is_adapted_to_its_drag(script, tmp_path):
    numbers = script("adapt_grid").main(quick=True, figures=tmp_path)
    given = numbers["members"][1]
    assert numbers["adapted"]["n_cells"] == given["n_cells"]
    assert 0.0 < numbers["adapted"]["CD"] < 0.65 * given["CD"]
    assert numbers["lift_ratio"] < 0.6
    for key in ("estimate", "bound"):
        assert 0.0 < numbers[key][1] < 0.8 * numbers[key][0]
    assert all(after < 0.7 * before for before, after in numbers["others"].values())
    assert (tmp_path / "adapt_grid.png").stat().st_size > 50_000
