"""The runner itself: ranks that fail or wait for ever are shown and leave nothing behind."""

import os
import re
import time

import pytest
from parallel_cases import run_ranks


def ends(pid: int, within: float = 5.0) -> bool:
    """Whether a process ends within some time (s)."""
    start = time.monotonic()
    while time.monotonic() - start < within:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


@pytest.mark.parametrize("n", [2, 3])
def test_all_ranks_raise_what_the_first_one_raises(n):
    assert run_ranks("cases/fail_together.py", n) == [f"done {rank}\n" for rank in range(n)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "shown"), [("hangs", "Timeout"), ("raises", "the last rank fails"), ("dies", "(?i)exit code: *3")]
)
def test_ranks_that_fail_are_shown_and_leave_nothing_behind(how, shown):
    start = time.monotonic()
    with pytest.raises(AssertionError, match="---- rank 1 of 2") as failure:
        run_ranks("cases/hang.py", 2, how, timeout=4.0)
    assert time.monotonic() - start < 12.0
    words = str(failure.value)
    assert re.search(shown, words)
    pids = [int(pid) for pid in re.findall(r"rank \d is (\d+)", words)]
    assert len(pids) == 2
    assert all(map(ends, pids))
