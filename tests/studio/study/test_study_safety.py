"""What studies cannot do: run code, run away, or end in anything but one line that names the key."""

import ast
import json
import re
from contextlib import suppress
from dataclasses import replace

import openmdao.api as om
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from openmdao.components import exec_comp
from public_imports import hidden_names
from study_cases import study_of
from unusable_studies import BASE, UNUSABLE, edited

from bspline_mdao import NLoptDriver, ScipyDriver
from bspline_mdao.errors import InputError
from bspline_mdao.studio.study.expressions import fault_of, names_in, renamed
from bspline_mdao.studio.study.kinds import slices_of
from bspline_mdao.studio.study.names import FUNCTIONS, fault_of_name
from bspline_mdao.studio.study.script import study_script

CALLED = re.compile(
    r"""bm\.((design\.|files\.|generators\.|measures\.|movers\.)?\w+(\.(of|at|grid|integral|box|load))?)
    | om\.(ExecComp|Problem|SqliteRecorder)
    | wing\.(axis_at|grid_movement|parametrization)
    | top\.(add_\w+|connect|set_input_defaults) | driver\.add_recorder | problem\.(setup|set_val|get_val|run_\w+)
    | model\.(save|regenerate) | after\.(write_csv|table) | conditions\.items | values\.items
    | world | together | str | print | Path | Path\(__file__\)\.resolve
    | wing\.parametrization\(variables\)\.extremes | problem\.get_val\("control_points"\)\.reshape""",
    re.VERBOSE,
)
"""Calls that scripts hold."""

NODES = (
    *(ast.Module, ast.Expr, ast.Import, ast.ImportFrom, ast.alias, ast.Assign, ast.For, ast.With, ast.withitem, ast.If),
    *(ast.Call, ast.keyword, ast.Attribute, ast.Name, ast.Constant, ast.List, ast.Tuple, ast.Dict, ast.Starred),
    *(ast.Subscript, ast.Slice, ast.BinOp, ast.UnaryOp, ast.Compare, ast.IfExp, ast.JoinedStr, ast.FormattedValue),
    *(ast.expr_context, ast.operator, ast.unaryop, ast.cmpop),
)
"""What scripts are made of."""

EVIL = [
    "'''", '"""', '"""\nimport os\n"""', "'); __import__('os').system('touch ran'); ('", "\\", '\\"', "a,b", "a ( b",
    "{x}", "a\\unit.h5", "x\n__import__('os')", "maxtime=__import__('os').system('touch ran') or 5.0, stopval", "#",
    "\r", "__import__('os')", "CD if x else y", "lambda", "a.b.c", "CD,CD", "[CD for CD in CD]", "*", "**", "\u2028",
    "CD#", "",
]  # fmt: skip
STRINGS = st.sampled_from(EVIL) | st.text(max_size=20)
PLACES = {
    "@onera_m6:7x7x5": json.dumps,
    "CD_induced": json.dumps,
    ":, :, 1:": json.dumps,
    "LD_SLSQP": json.dumps,
    "disp": json.dumps,
    "variables.bumps": lambda text: f"variables.{json.dumps(text)}",
    "measures.volume": lambda text: f"measures.{json.dumps(text)}",
    "constraints.CL": lambda text: f"constraints.{json.dumps(text)}",
    "[5, 5, 5]": lambda text: f"[5, 5, 5]\ndesign = {json.dumps(text)}\nfixed = [{json.dumps(text)}]",
    "[4, 3, 3]": lambda text: f"[4, 3, 3]\ndirection = {json.dumps(text)}",
    "false\n\n": lambda text: f"false\nlocal_optimizer = {json.dumps(text)}\n\n",
    "n_chord = 3": lambda text: f"axes = {json.dumps(text)}",
    "2\n\n[driver.options]": lambda text: f"2\n[conditions.{json.dumps(text)}]\n[driver.options]",
}
"""Texts in the study that is good, and what stands there instead."""


def check_tree(script):
    """See that a script holds nothing but what scripts are made of, and in its expressions arithmetic alone."""
    tree = ast.parse(script)
    for node in ast.walk(tree):
        assert isinstance(node, NODES), ast.unparse(node)
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func).replace("'", '"')
            assert CALLED.fullmatch(called), called
            if called == "om.ExecComp":
                _, _, formula = ast.literal_eval(node.args[0]).partition(" = ")
                assert fault_of(formula or "none given") == "", formula
    assert ast.get_docstring(tree) == DOCSTRING
    imported = [ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert set(imported) <= IMPORTS, imported
    assert hidden_names(script) == []


DOCSTRING = """The optimisation that a study stands for.

Written and run by ``bspline-mdao optimize``: the results next to it come from this script, which writes them again
when it is run again. Continue here where a study ends."""
IMPORTS = {
    *("from pathlib import Path", "import numpy as np", "import openmdao.api as om", "import bspline_mdao as bm"),
    "from bspline_mdao.parallel import together, world",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("studies")


def quoted(before):
    """A text of the study with its quotes."""
    return f'"{before}"' if f'"{before}"' in BASE else before


@pytest.mark.slow
@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(list(PLACES)), STRINGS)
@example("disp", EVIL[11])
@example("@onera_m6:7x7x5", '"""')
def test_a_script_calls_what_scripts_call_whatever_the_texts_of_the_study_are(folder, place, text):
    changed = BASE.replace(quoted(place), PLACES[place](text), 1)
    assert changed != BASE
    with suppress(InputError):
        check_tree(study_script(study_of(folder, changed), folder))


@pytest.mark.slow
@given(STRINGS, STRINGS)
@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_files_and_patterns_stand_in_a_script_as_they_are(folder, name, pattern):
    study = study_of(folder, BASE)
    grid = study.grid | {"file": f"x{name}", "patches": name, "design": [pattern], "sliding": pattern or None}
    variables = study.variables | {"bumps": study.variables["bumps"] | {"kind": "control_points", "patches": [pattern]}}
    script = ""
    with suppress(ValueError):  # no file can be called so
        script = study_script(replace(study, grid=grid, variables=variables), folder)
    if not script:
        assert re.search("[\x00\ud800-\udfff]", name)
        return
    check_tree(script)
    constants = [node.value for node in ast.walk(ast.parse(script)) if isinstance(node, ast.Constant)]
    assert pattern in constants


@pytest.mark.parametrize("name", UNUSABLE)
def test_a_study_that_cannot_be_used_is_one_line_with_the_line_of_its_key(folder, name):
    edit, line = UNUSABLE[name]
    with pytest.raises(InputError) as error:
        study_of(folder, edited(edit))
    message = str(error.value)
    assert line is None or f"study.toml: line {line}: " in message, message
    assert len(message.replace(str(folder), "")) < 700
    assert not (folder / "ran").exists()


def test_the_study_that_is_edited_is_good(folder):
    study = study_of(folder, BASE)
    assert (study.n_values, len(study.constraints)) == (float("inf"), 2)
    check_tree(study_script(study, folder))


@pytest.mark.parametrize("optimizer", ["LD_SLSQP", "SLSQP"])
def test_options_are_those_that_the_driver_declares(folder, optimizer):
    text = BASE.replace("LD_SLSQP", optimizer)
    driver = NLoptDriver() if optimizer == "LD_SLSQP" else ScipyDriver()
    for option, _ in driver.options.items():
        changed = text.replace("disp = false", f"{option} = 2024-05-01")
        with pytest.raises(InputError, match=rf"line 39: \[driver.options\] '{option}' is (datetime|the key)"):
            study_of(folder, changed)
    with pytest.raises(InputError, match=r"'dips' is no option of .*; did you mean 'disp'"):
        study_of(folder, text.replace("disp =", "dips ="))
    assert study_of(folder, text).driver["options"] == {"disp": False}
    inline = text.replace("\n[driver.options]\ndisp = false", "options = { disp = false, maxtim = 1 }")
    with pytest.raises(InputError, match=r"line 37: \[driver.options\] 'maxtim' is no option"):
        study_of(folder, inline)


def test_names_that_expressions_and_groups_of_openmdao_have_are_refused(folder):
    taken = {name for name in {*exec_comp._expr_dict, *exec_comp._option_names} if name[0] != "_"}
    assert taken <= FUNCTIONS, "of a newer OpenMDAO: add these"
    assert all(fault_of_name("measures", name) for name in taken)
    for name in ("options", "setup", "name", "comm"):
        assert hasattr(om.Group(), name)
        assert fault_of_name("conditions", name)
    assert not any(fault_of_name("variables", name) for name in ("shape", "twist", "x_1", "sin"))


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (":, :, 1:", (slice(None), slice(None), slice(1, None))),
        ("0, -1 ,::2", (0, -1, slice(None, None, 2))),
        ("-3:-1:-1,1:2,:", (slice(-3, -1, -1), slice(1, 2), slice(None))),
        *((text, None) for text in ("", ",,", "1", ":,:", ":,:,:,:", "a,:,:", "0:3:0,:,:", "--1:,:,:", "1 2,:,:")),
        ("\u0661,:,:", None),
    ],
)  # fmt: skip
def test_slices_are_those_of_an_index(text, found):
    assert slices_of(text) == found
    if found is not None:
        assert eval(f"index[{text}]", {"index": Index()}) == found


class Index:
    """Gives its index back."""

    def __getitem__(self, index):
        return index


NAMES = st.sampled_from(["CL", "cruise.CD", "volume", "CD_induced"])
SIGNS = st.sampled_from(["+", "-", "*", " / ", "**"])
EXPRESSIONS = st.recursive(
    NAMES | st.sampled_from(["1", "2.5", "0.5", "1e3"]),
    lambda inner: st.builds("({}{}{})".format, inner, SIGNS, inner) | inner.map("-{}".format),
    max_leaves=12,
)


@given(EXPRESSIONS)
@settings(max_examples=200)
def test_an_expression_under_other_names_has_the_same_value_or_is_refused(of):
    flat = {"CL": 0.3, "cruise_CD": 0.02, "volume": 1.1, "CD_induced": 0.01}
    if fault_of(of):
        assert re.search("divides by|is no number up to", fault_of(of)), fault_of(of)
        return
    names = names_in(of)
    assert set(names) <= {"CL", "cruise.CD", "volume", "CD_induced"}
    other = renamed(of, lambda name: name.replace(".", "_"))
    assert other == of.replace("cruise.CD", "cruise_CD")
    compile(other, "", "eval")
    assert {node.id for node in ast.walk(ast.parse(other)) if isinstance(node, ast.Name)} <= set(flat)
