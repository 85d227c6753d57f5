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
