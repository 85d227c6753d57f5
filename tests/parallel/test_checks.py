"""Checks that a user calls on several ranks end, and find products exact."""

import pytest
from parallel_cases import run_ranks

pytestmark = pytest.mark.slow


def test_check_partials_ends_and_finds_products_exact_on_every_rank():
    assert all("checked" in text for text in run_ranks("cases/check_partials.py", 2))
