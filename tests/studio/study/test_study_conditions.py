"""Flight conditions of studies: what can be written, what is said of what cannot, and what script they make."""

import pytest
from study_cases import STUDY, study_of

from bspline_mdao.errors import InputError
from bspline_mdao.studio.study.expressions import fault_of, names_in, renamed
from bspline_mdao.studio.study.script import study_script

CONDITIONS = (
    STUDY.replace('"lattice"', '"euler"')
    + """
[conditions.cruise]
Mach_number = 0.5
CL_target = 0.25
weight = 2

[conditions.climb]
alpha = 4.0

[constraints.cruise.CM_bending]
upper = 0.2

[constraints.lift]
of = "climb.CL / cruise.CL"
upper = 2.0
"""
)

WRONG_CONDITIONS = {
    "alpha = 4.0 -> alpha = 4.0\nCL_target = 0.3": r"line 27: \[conditions.climb\] 'alpha' is solved for if",
    "alpha = 4.0 -> aplha = 4.0": r"line 27: \[conditions.climb\] 'aplha' is no key; did you mean 'alpha'\?",
    "weight = 2 -> weight = -2": "line 24: .* 'weight' is -2; give 0 or a positive number",
    "alpha = 4.0 -> alpha = 4.0\n[conditions.twist]": r"line 28: \[conditions\] 'twist' is the name of a variable or",
    "alpha = 4.0 -> alpha = 4.0\n[conditions.grid]": r"line 28: \[conditions\] 'grid' is a name already in use",
    "[constraints.cruise.CM_bending] -> [constraints.criuse.CM_bending]": r"line 29: \[constraints\] 'criuse' is no "
    "condition; did you mean 'cruise'\\? the conditions are cruise, climb",
    "[constraints.cruise.CM_bending] -> [constraints.cruise]": r"line 30: \[constraints.cruise\] 'upper' names no "
    r"response; write \[constraints.cruise.CL\]",
    "cruise.CM_bending] -> cruise.CM_bendin]": r"line 29: \[constraints.cruise\] 'CM_bendin' names 'CM_bendin', ",
    "climb.CL / cruise.CL -> clmb.CL / cruise.CL": r"line 33: .* there is no 'clmb.CL': 'clmb' is no condition",
    "climb.CL / cruise.CL -> climb.CD_entrpy": r"line 33: .* did you mean 'climb.CD_entropy'\?",
    'kind = "euler" -> kind = "lattice"': r"line 23: \[conditions.cruise\] 'CL_target' is for euler, which",
    "alpha = 4.0 -> Mach_number = 0.4": None,
    'kind = "euler" -> kind = "euler"\ntrim = true': None,
    "alpha = 4.0 -> weight = 0": None,
}


@pytest.mark.parametrize("edit", WRONG_CONDITIONS)
def test_what_is_wrong_with_conditions_is_named_with_its_line(tmp_path, edit):
    before, after = edit.split(" -> ")
    assert CONDITIONS.count(before) == 1
    text = CONDITIONS.replace(before, after)
    if WRONG_CONDITIONS[edit] is None:
        assert list(study_of(tmp_path, text).conditions) == ["cruise", "climb"]
        return
    with pytest.raises(InputError, match=WRONG_CONDITIONS[edit]):
        study_of(tmp_path, text)


def test_conditions_need_a_flow_weights_and_a_lift_where_they_are_trimmed(tmp_path):
    alone = CONDITIONS.replace('[flow]\nkind = "euler"', "").replace("equals = 0.22", "equals = 0.22\nof = 'volume'")
    with pytest.raises(InputError, match=r"'conditions' need a flow, and there is none; add \[flow\]"):
        study_of(tmp_path, alone)
    idle = CONDITIONS.replace("weight = 2", "weight = 0").replace("alpha = 4.0", "weight = 0")
    with pytest.raises(InputError, match="line 21: 'conditions' have no weight above 0, and"):
        study_of(tmp_path, idle)
    trimmed = CONDITIONS.replace('"euler"', '"euler"\ntrim = true').replace("alpha = 4.0", "weight = 0")
    with pytest.raises(InputError, match=r"line 27: \[conditions\] 'climb' needs a target lift; give CL_target"):
        study_of(tmp_path, trimmed)
    with pytest.raises(InputError, match=r"'cruise' is no condition; add \[conditions.cruise\]"):
        study_of(tmp_path, STUDY.replace("[constraints.CL]", "[constraints.cruise.CL]"))
    solved = CONDITIONS.replace("alpha = 4.0", "CL_target = 0.4") + "[variables.alpha]\nlower = 0\nupper = 5\n"
    with pytest.raises(InputError, match=r"\[variables\] 'alpha' is solved for at all conditions; leave it out"):
        study_of(tmp_path, solved)
    lists = CONDITIONS + "[variables.alpha]\nlower = [0, 1]\nupper = 5\n"
    with pytest.raises(InputError, match=r"\[variables.alpha\] 'lower' has 2 numbers; give one number, or 1"):
        study_of(tmp_path, lists)


def test_conditions_have_flows_of_their_own_on_one_grid(tmp_path):
    study = study_of(tmp_path, CONDITIONS)
    assert study.conditions["cruise"] == {
        "Mach_number": 0.5, "alpha": 2.0, "trim": True, "CL_target": 0.25, "weight": 2
    }  # fmt: skip
    assert study.conditions["climb"]["trim"] is False
    assert list(study.constraints) == ["CL", "cruise.CM_bending", "lift"]
    script = study_script(study, tmp_path)
    compile(script, "script", "exec")
    for line in (
        '    "cruise": {"Mach_number": 0.5, "CL_target": 0.25},',
        '    "climb": {"Mach_number": 0.3, "alpha": 4.0},',
        '    top.add_subsystem(name, flow, promotes_inputs=["grid"])',
        '    om.ExecComp("mean_CD_induced = (2 * cruise_CD_induced + climb_CD_induced) / 3"),',
        'top.connect("climb.CD_induced", "objective_expression.climb_CD_induced")',
        'top.add_objective("mean_CD_induced", ref=0.01)',
        'top.add_constraint("cruise.CL", equals=0.22, ref=0.22)',
        'top.add_constraint("climb.CL", equals=0.22, ref=0.22)',
        'top.add_constraint("cruise.CM_bending", upper=0.2, ref=0.2)',
        'top.add_constraint("lift_value", upper=2.0, ref=2.0)',
    ):
        assert line in script.splitlines()


def test_expressions_keep_their_value_under_other_names():
    of = "2 * cruise.CD + (volume - cruise.CD) ** 2 / -climb.CL"
    assert names_in(of) == ["cruise.CD", "volume", "climb.CL"]
    other = renamed(of, lambda name: name.replace(".", "_"))
    values = {"cruise_CD": 0.7, "volume": 1.3, "climb_CL": 0.4}
    assert eval(other, values) == 2 * 0.7 + (1.3 - 0.7) ** 2 / -0.4
    for wrong in ("a.b.c", "f(a).b", "a if b else c", "'text'.b"):
        assert fault_of(wrong)
