"""Ranks that the tests of several processes share."""

import pytest
from parallel_cases import STARTED


@pytest.fixture(scope="session", autouse=True)
def ranks_end_with_the_tests():
    """End the ranks that wait for another script."""
    yield
    while STARTED:
        STARTED.popitem()[1].end()
