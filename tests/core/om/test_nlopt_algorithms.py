"""The table of algorithms is what NLopt itself does."""

import re
from pathlib import Path

import nlopt
import numpy as np
import pytest

from bspline_mdao import InputError
from bspline_mdao.core.om.drivers.nlopt_algorithms import ALGORITHMS, Needs, find_algorithm, missing, suitable

KINDS = ("GN", "GD", "LN", "LD", "G", "AUGLAG")
COMPILED = [name for name, algorithm in ALGORITHMS.items() if algorithm.is_compiled]


def optimizer(name, n=2):
    """NLopt's optimizer of a small bowl within a box, with a local optimizer if it needs one."""
    optimizer = nlopt.opt(getattr(nlopt, name), n)
    optimizer.set_min_objective(bowl)
    optimizer.set_lower_bounds(np.full(n, -1.0))
    optimizer.set_upper_bounds(np.full(n, 2.0))
    optimizer.set_maxeval(60)
    if ALGORITHMS[name].local_optimizer == "needed":
        local = nlopt.opt(nlopt.LD_MMA, n)
        local.set_maxeval(20)
        optimizer.set_local_optimizer(local)
    return optimizer


def bowl(x, gradient):
    if gradient.size:
        gradient[:] = 2.0 * (x - 0.3)
    return float((x - 0.3) @ (x - 0.3))


def plane(x, gradient):
    if gradient.size:
        gradient[:] = 1.0
    return float(x.sum() - 0.5)


def is_accepted(run):
    """Whether NLopt accepts what is asked, whatever comes of it."""
    try:
        run()
    except nlopt.RoundoffLimited:
        return True
    except Exception:
        return False
    return True


def test_no_algorithm_of_nlopt_is_missing():
    names = {name for name in dir(nlopt) if name.split("_")[0] in KINDS}
    assert len(names) > 40
    assert names - set(ALGORITHMS) == set()
    assert {name for name in ALGORITHMS if not hasattr(nlopt, name)} <= {"LD_LBFGS_NOCEDAL"}


@pytest.mark.parametrize("name", COMPILED)
def test_every_algorithm_takes_the_constraints_that_the_table_says_and_no_others(name):
    for kind, is_taken in (("inequality", ALGORITHMS[name].inequality), ("equality", ALGORITHMS[name].equality)):
        problem = optimizer(name)

        def run(problem=problem, kind=kind):
            getattr(problem, f"add_{kind}_constraint")(plane, 1e-6)
            problem.optimize([0.1, 0.2])

        assert is_accepted(run) == is_taken, kind


@pytest.mark.parametrize("name", COMPILED)
def test_every_algorithm_asks_for_gradients_as_the_table_says(name):
    asked = []

    def remembering(x, gradient):
        asked.append(gradient.size > 0)
        return bowl(x, gradient)

    problem = optimizer(name)
    problem.set_min_objective(remembering)
    assert is_accepted(lambda: problem.optimize([0.1, 0.2]))
    generic = ALGORITHMS[name].local_optimizer == "needed"
    assert any(asked) == (ALGORITHMS[name].gradients or generic)


@pytest.mark.parametrize("name", [name for name in COMPILED if ALGORITHMS[name].bounds == "taken"])
def test_bounds_that_are_taken_are_kept(name):
    visited = []

    def remembering(x, gradient):
        visited.append(x.copy())
        return bowl(x, gradient)

    problem = optimizer(name)
    problem.set_upper_bounds([0.2, 0.25])
    problem.set_min_objective(remembering)
    assert is_accepted(lambda: problem.optimize([0.1, 0.2]))
    assert np.all(np.array(visited) <= [0.2, 0.25])


def test_bounds_that_are_ignored_are_not_kept():
    problem = optimizer("LN_NEWUOA")
    problem.set_upper_bounds([0.2, 0.25])
    assert np.all(problem.optimize([0.1, 0.2]) > [0.25, 0.28])


@pytest.mark.parametrize("name", [name for name, found in ALGORITHMS.items() if found.local_optimizer == "needed"])
def test_algorithms_that_need_another_do_not_run_without(name):
    problem = nlopt.opt(getattr(nlopt, name), 2)
    problem.set_min_objective(bowl)
    problem.set_lower_bounds([-1.0, -1.0])
    problem.set_upper_bounds([1.0, 1.0])
    problem.set_maxeval(20)
    assert not is_accepted(lambda: problem.optimize([0.1, 0.2]))


def test_names_tell_gradients_and_global_search():
    for name, algorithm in ALGORITHMS.items():
        assert algorithm.is_global == name.startswith("G")
        assert algorithm.gradients == (name.split("_")[0] in ("LD", "GD"))


NEEDS = {
    "takes no equality constraints ('lift', 'area', 'span', ...)": (
        "LD_MMA",
        Needs(5, equality=("lift", "area", "span", "mass")),
    ),
    "takes no inequality constraints ('lift')": ("LD_LBFGS", Needs(5, inequality=("lift",))),
    "ignores bounds ('chord')": ("LN_NEWUOA", Needs(5, bounded=("chord",))),
    "needs finite bounds on all design variables ('twist')": ("GN_ISRES", Needs(5, unbounded=("twist",))),
    "needs at least 2 design variables": ("LN_BOBYQA", Needs(1)),
    "needs gradients": ("LD_SLSQP", Needs(2, has_derivatives=False)),
    "is not compiled": ("LD_LBFGS_NOCEDAL", Needs(2)),
}


@pytest.mark.parametrize("lack", NEEDS)
def test_what_an_algorithm_lacks_is_said_in_one_line_with_those_that_would_do(lack):
    name, needs = NEEDS[lack]
    with pytest.raises(InputError) as raised:
        find_algorithm(name, needs)
    message = str(raised.value)
    assert f"{name} {lack}" in message
    assert "\n" not in message
    named = message.split("possible ones: ")[1].removesuffix(", ...").split(", ")
    assert named
    assert all(missing(ALGORITHMS[other], needs) is None for other in named)


def test_both_kinds_of_constraints_are_taken_by_those_that_nlopt_documents():
    needs = Needs(3, inequality=("a",), equality=("b",))
    local = {found.name for found in suitable(needs) if found.local_optimizer == "none"}
    assert local == {"LD_SLSQP", "LN_COBYLA", "GN_ISRES"}
    only = {found.name for found in suitable(Needs(3, inequality=("a",))) if found.local_optimizer == "none"}
    assert only - local == {"LD_MMA", "LD_CCSAQ", "GN_ORIG_DIRECT", "GN_ORIG_DIRECT_L", "GN_AGS"}


def test_those_of_the_same_kind_are_named_if_there_are_any():
    named = {}
    for name, needs in {"GN_DIRECT": Needs(2, inequality=("a",)), "GN_ISRES": Needs(2, unbounded=("x",))}.items():
        with pytest.raises(InputError) as raised:
            find_algorithm(name, needs)
        named[name] = str(raised.value).split("possible ones: ")[1].split(", ")
    assert named["GN_DIRECT"] == ["GN_ORIG_DIRECT", "GN_ORIG_DIRECT_L", "GN_ISRES", "GN_AGS"]
    assert named["GN_ISRES"][0] == "LD_SLSQP"
    with pytest.raises(
        InputError, match=r"local_optimizer LD_LBFGS takes no inequality .*: LD_SLSQP, LD_MMA, LD_CCSAQ, LN"
    ):
        find_algorithm("LD_LBFGS", Needs(2, inequality=("a",)), is_subsidiary=True)


def test_the_table_of_the_documentation_is_the_table_of_the_code():
    page = (Path(__file__).parents[3] / "docs" / "theory" / "drivers.rst").read_text()
    table = page[page.index("Algorithm ") :].split("Augmented Lagrangians that end")[0]
    rows = {}
    columns = [match.span() for match in re.finditer("=+", table.splitlines()[1])]
    for line in table.splitlines()[2:]:
        cells = [line[start:end].strip().replace("\\", "").strip() for start, end in columns]
        rows[cells[0].strip("`")] = cells[1:]
    runs_another = {"none": "", "optional": "may", "needed": "must"}
    assert {name for name in rows if name in ALGORITHMS} == set(ALGORITHMS)
    for name, algorithm in ALGORITHMS.items():
        assert rows[name] == [
            algorithm.title,
            "yes" if algorithm.inequality else "",
            "yes" if algorithm.equality else "",
            algorithm.bounds,
            runs_another[algorithm.local_optimizer],
            "yes" if algorithm.is_stochastic else "",
            algorithm.recovery if algorithm.is_compiled else "not compiled",
        ]


def test_the_example_of_the_documentation_runs():
    page = (Path(__file__).parents[3] / "docs" / "theory" / "drivers.rst").read_text()
    example = page.split(".. code-block:: python\n")[1].split("\nWhat it guarantees")[0]
    contents = {}
    exec("\n".join(line[3:] for line in example.splitlines()), contents)
    assert contents["result"].success
    assert contents["problem"].get_val("d").item() == pytest.approx(-12.0, abs=1e-6)
