"""Studies of sections: variables and measures once, and coefficients per unit of span."""

import numpy as np
import pytest
from parametrization_cases import section_model
from study_cases import STUDY, study_of

import bspline_mdao as bm
from bspline_mdao import InputError
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.study import keys
from bspline_mdao.studio.study.script import study_script

VARIABLES = {
    "hicks_henne": ("places = [0.3, 0.7]\nsides = 'upper'\npower = 4.0", 2),
    "class_shape": ("degree = 3\ntrailing = true\nnose = false", 7),
    "camber_modes": ("n_modes = 2\nleading = true", 3),
    "thickness_modes": ("", 4),
    "thickness_points": ("n_points = 5", 5),
    "curve_points": ("direction = 'y'", 14),
}
"""Keys of every kind, and the number of its values on the section below."""

SECTION = "\n".join(
    f"[variables.{kind}]\n{text}\nlower = -0.003\nupper = 0.004" for kind, (text, _) in VARIABLES.items()
)

FLOW = f"""\
[grid]
file = "foil.h5"

{SECTION}

[flow]
kind = "euler"
Mach_number = 0.4

[objective]
of = "CL"
maximize = true

[constraints.section_area]
lower = 1.0

[constraints.thickness_at]
lower = 0.9

[constraints.thickness]
lower = 0.8

[constraints.section_thickness]
lower = 0.1

[constraints.leading_edge_radius]
lower = 0.8

[constraints.trailing_edge_angle]
lower = 0.1

[driver]
max_iterations = 2

[output]
estimate_errors = false
"""


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    section_model((0.0, 0.7), (0, 1, 2), 1.0, 32, (17, 8, 2)).save(tmp_path / "foil.h5")
    return tmp_path


def test_variables_and_measures_of_a_section_come_once_and_coefficients_are_those_of_a_unit_of_span(workplace, capsys):
    pytest.importorskip("plotly", reason="the extra report is not installed")
    (workplace / "study.toml").write_text(FLOW)
    assert run(["optimize", "study.toml", "-o", "out"]) == 0
    printed = capsys.readouterr().out
    rows = (workplace / "out" / "summary.csv").read_text().splitlines()
    names = [row.split(",")[1].partition("[")[0] for row in rows[1:]]
    assert {kind: names.count(kind) for kind in VARIABLES} == {kind: n for kind, (_, n) in VARIABLES.items()}
    assert {name: names.count(name) for name in keys.MEASURES if name in names} == {
        "section_area": 1, "thickness_at": 5, "thickness": 5, "section_thickness": 1, "leading_edge_radius": 1,
        "trailing_edge_angle": 1,
    }  # fmt: skip
    assert {"CL", "CD", "CD_entropy"} <= set(names)
    assert not {"CD_induced", "CM_bending"} & set(names)
    page = (workplace / "out" / "report.html").read_text()
    for text in (printed, page):
        assert "CL, CD and CM are section coefficients, cl, cd and cm: per unit of span" in text
        assert "CD_induced" not in text


EVEN = """\
[grid]
file = "foil.h5"

[variables.points]
kind = "thickness_points"
n_points = 3
lower = 0.0
upper = [0.03, 0.03, 0.01]
ref = 0.02

[flow]
kind = "euler"
alpha = 0.0
Mach_number = 0.6
anchored = true

[objective]
of = "CD"

[driver]
optimizer = "SLSQP"
max_iterations = 2
even_pressures = "points"

[output]
estimate_errors = false
report = false
picture = false
"""


def test_a_driver_sees_combinations_along_which_pressures_change_evenly_and_bounds_as_constraints(workplace):
    (workplace / "study.toml").write_text(EVEN)
    assert run(["optimize", "study.toml", "-o", "out"]) == 0
    rows = [row.split(",") for row in (workplace / "out" / "summary.csv").read_text().splitlines()[1:]]
    names = {table: [name for each, name, *_ in rows if each == table] for table in ("variable", "constraint")}
    assert names == {
        "variable": [f"points_combinations[{number}]" for number in range(3)],
        "constraint": [f"points[{number}]" for number in range(3)],
    }
    script = (workplace / "out" / "optimize.py").read_text()
    assert script.count("anchored=True") == 2
    found = {"__file__": str(workplace / "out" / "optimize.py"), "__name__": "__main__"}
    exec(compile(script.partition("outputs = [")[0], "optimize.py", "exec"), found)
    problem, changes = found["problem"], []
    problem.setup()
    for number in range(3):
        combinations = np.zeros(3)
        for sign in (1.0, -1.0):
            combinations[number] = 1e-3 * sign
            problem.set_val("points_combinations", combinations)
            problem.run_model()
            changes.append(sign * problem.get_val("Cp"))
    rates = np.reshape(changes, (3, 2, -1)).sum(axis=1) / 2e-3
    corners = problem.get_val("grid").reshape(-1, 3)[bm.plotting.wall_quads(found["model"])]
    areas = np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1)
    np.testing.assert_allclose((rates * areas / areas.sum()) @ rates.T, np.eye(3), atol=0.05)


@pytest.mark.parametrize(
    ("edit", "complaint"),
    [
        ('even_pressures = "points" -> even_pressures = "pints"', "names 'pints', which is no variable; did you mean"),
        ("lower = 0.0 -> lower = 0.0\nstart = 0.0", "does not go with 'start' of [variables.points]"),
        (
            'optimizer = "SLSQP" -> optimizer = "L-BFGS-B"',
            "L-BFGS-B, which takes no constraints; take SLSQP or LD_SLSQP",
        ),
        ('kind = "euler" -> kind = "lattice"', "needs pressures of Euler flow at one condition; leave it out"),
    ],
)
def test_combinations_that_cannot_be_are_refused(workplace, edit, complaint):
    before, after = edit.split(" -> ")
    text = EVEN.replace(before, after)
    text = text.replace("anchored = true\n", "") if "lattice" in after else text
    with pytest.raises(InputError) as error:
        study_of(workplace, text)
    assert "[driver] 'even_pressures' " in str(error.value)
    assert complaint in str(error.value)


def test_a_wing_has_the_stations_that_it_had_and_its_induced_drag(tmp_path):
    text = f"{STUDY}\n[constraints.leading_edge_radius]\nlower = 0.9\n[constraints.thickness]\nlower = 0.8\n"
    script = study_script(study_of(tmp_path, text), tmp_path)
    assert "stations=None if wing.surface.is_section else [0.1, 0.5, 0.9]" in script
    assert "n_span=None if wing.surface.is_section else 5" in script
    assert '"CD_induced"' in script
    given = text.replace("lower = 0.9", "lower = 0.9\n[measures.leading_edge_radius]\nstations = [0.3]")
    assert "stations=[0.3]" in study_script(study_of(tmp_path, given), tmp_path)


@pytest.mark.parametrize("kind", [kind for kind in VARIABLES if kind != "curve_points"])
@pytest.mark.parametrize("stations", ["", "stations = 3", "stations = [0.2, 0.9]"])
def test_a_study_knows_how_many_values_a_section_has(tmp_path, kind, stations):
    keys_of, n = VARIABLES[kind]
    n *= {"": 1, "stations = 3": 3}.get(stations, 2)
    head, _, tail = STUDY.partition("[variables.twist]\nstations = 3\nlower = -6.0\nupper = 6.0\n")
    text = f"{head}[variables.{kind}]\n{keys_of}\n{stations}\nlower = {[-0.1] * n}\nupper = 0.1\n{tail}"
    study = study_of(tmp_path, text)
    assert study.n_values == n
    with pytest.raises(InputError, match=rf"'lower' has {n + 1} numbers; give one number, or {n}"):
        study_of(tmp_path, text.replace(str([-0.1] * n), str([-0.1] * (n + 1))))
    script = study_script(study, tmp_path)
    made = next(line for line in script.splitlines() if f'("{kind}"' in line).strip().rstrip(",")
    variable = eval(made, {"bm": bm})
    per_section = variable.shapes(np.array([0.3]), np.ones(1)).shape[1]
    assert (
        per_section * np.size(np.arange(variable.stations) if np.ndim(variable.stations) == 0 else variable.stations)
        == n
    )


def test_the_flow_about_a_section_has_no_induced_drag():
    flows = {model: bm.EulerFlow(model=model, reference_area=1.0) for model in (section_model(), wing_of_a_half())}
    assert [flow.is_section for flow in flows.values()] == [True, False]


def wing_of_a_half():
    return bm.fit_grid(bm.generators.onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4))
