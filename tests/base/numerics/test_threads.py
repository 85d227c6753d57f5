"""Tasks on several threads."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
import scipy.linalg.lapack  # noqa: F401 - a BLAS to limit
from threadpoolctl import ThreadpoolController

from bspline_mdao.base.numerics.threads import map_tasks, one_blas_thread, run_tasks
from bspline_mdao.errors import InputError


def test_an_error_in_a_thread_reaches_the_caller():
    def fail(number):
        if number == 3:
            raise InputError("task 3")

    for n_threads in (1, 2):
        with pytest.raises(InputError, match="task 3"):
            run_tasks(fail, range(5), n_threads)


@pytest.mark.parametrize("n_threads", [1, 3])
def test_results_of_threads_come_in_order_and_an_error_ends_them(n_threads):
    done = []

    def square(number):
        if number == 50:
            raise InputError("task 50")
        time.sleep(0.002 * (number > 50))
        done.append(number)
        return number**2

    results = map_tasks(square, range(2000), n_threads)
    assert [next(results) for _ in range(50)] == [number**2 for number in range(50)]
    with pytest.raises(InputError, match="task 50"):
        next(results)
    assert sorted(done)[:50] == list(range(50))
    assert len(done) < 1999


@pytest.mark.parametrize("n_threads", [1, 3])
def test_threads_that_stay_give_results_in_the_order_of_what_they_work_on(n_threads):
    def halved(number):
        time.sleep(1e-4 * (number % 3))
        return number / 2

    numbers = [7 * k % 50 for k in range(50)]
    assert run_tasks(halved, numbers, n_threads) == [number / 2 for number in numbers]


def test_blas_has_one_thread_inside_and_its_own_number_outside():
    blas = ThreadpoolController().select(user_api="blas")

    def n_threads():
        return [library.num_threads for library in blas.lib_controllers]

    with ThreadPoolExecutor(1) as another:  # a limit of this thread would be the user's, and stay
        limit = another.submit(lambda: blas.limit(limits=2)).result()
    try:
        with one_blas_thread, one_blas_thread:
            assert n_threads() == [1] * len(n_threads())
        assert n_threads() == [2] * len(n_threads())
    finally:
        with ThreadPoolExecutor(1) as another:
            another.submit(limit.restore_original_limits).result()


def test_no_thread_is_started_to_limit_a_blas_that_has_one(monkeypatch):
    started, start = [], threading.Thread.start
    with ThreadpoolController().limit(limits=1, user_api="blas"):
        with one_blas_thread:
            pass  # looks for the libraries
        monkeypatch.setattr(threading.Thread, "start", lambda thread: started.append(thread) or start(thread))
        with one_blas_thread:
            pass
    assert not started
