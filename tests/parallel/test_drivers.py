"""Drivers on several ranks end where they do on one, with a failure of one rank on the way."""

import json

import openmdao.api as om
import pytest
from parallel_cases import run_ranks

pytestmark = pytest.mark.slow


def optimum(driver, n, cases):
    """Numbers of an optimisation on some ranks, which are those of every rank."""
    texts = run_ranks("cases/optimisation.py", n, driver, str(cases))
    numbers = [json.loads(text.splitlines()[-1]) for text in texts]
    assert all(each == numbers[0] for each in numbers)
    assert not any(text.splitlines()[1:] for text in texts[1:]), texts[1]
    return numbers[0]


@pytest.mark.parametrize(("driver", "ranks"), [("LD_SLSQP", (2, 3)), ("scipy", (2,))])
def test_the_optimum_of_several_ranks_is_that_of_one(driver, ranks, tmp_path):
    found = {n: optimum(driver, n, tmp_path / f"{n}.sql") for n in (1, *ranks)}
    counts = {len(om.CaseReader(str(tmp_path / f"{n}.sql")).list_cases("driver", out_stream=None)) for n in (1, *ranks)}
    assert len(counts) == 1
    assert counts.pop() > 5
    for numbers in found.values():
        assert numbers["success"]
        assert numbers["failed"] == 1
        for name in ("twist", "chord", "distance", "area", "corner_ks"):
            assert numbers[name] == pytest.approx(found[1][name], rel=1e-8, abs=1e-10)


def test_the_wing_of_the_run_script_is_that_of_one_process():
    one, two = (json.loads(run_ranks("cases/wing.py", n)[0].splitlines()[-1]) for n in (1, 2))
    assert one["success"]
    assert two["success"]
    assert two["n_nodes"] == one["n_nodes"] == sum(each["nodes"] for each in two["processes"])
    assert two["evaluations"] == one["evaluations"]
    for start_or_end in ("initial", "optimal"):
        for name, value in one[start_or_end].items():
            assert two[start_or_end][name] == pytest.approx(value, rel=1e-7, abs=1e-9)
    assert one["optimal"]["CL"] == pytest.approx(0.35, rel=1e-5)
    assert one["optimal"]["CD_induced"] < 1.001 * one["initial"]["CD_induced"] * (0.35 / one["initial"]["CL"]) ** 2


def test_every_rank_has_the_history_that_the_first_one_has_recorded():
    (one,), two = (run_ranks("cases/recorded_run.py", n) for n in (1, 2))
    for text in two:
        assert json.loads(text.splitlines()[-1]) == json.loads(one.splitlines()[-1])
