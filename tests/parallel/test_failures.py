"""A failure of one rank is a failure of all, in runs and in setups, and they go on together."""

import pytest
from parallel_cases import run_ranks

pytestmark = pytest.mark.slow


def test_every_component_fails_on_all_ranks_alike_and_goes_on():
    first, last = run_ranks("cases/failing_component.py", 2, "run")
    assert first == last
    assert len(first.splitlines()) > 20


def test_an_option_that_is_wrong_on_one_rank_is_refused_on_all():
    texts = run_ranks("cases/failing_component.py", 3, "setup")
    assert len(set(texts)) == 1
    assert len(texts[0].splitlines()) == 3
