"""The Euler solver on several threads: the same bits as on one."""

from functools import cache

import numpy as np
import pytest
from euler_cases import case_of, with_guessed_patches
from numba import njit
from topology_cases import grid_of, smooth_box, split

from bspline_mdao.base.numerics.threads import run_tasks
from bspline_mdao.base.numerics.work_queue import claim, counters, finish
from bspline_mdao.flow.euler import block_factor, cell_sums
from bspline_mdao.flow.euler.block_factor import levels_of
from bspline_mdao.flow.euler.factor_pattern import FactorPattern
from bspline_mdao.flow.euler.preconditioner import compact_factor, time_terms


@cache
def case():
    return case_of(with_guessed_patches(grid_of(*split(smooth_box(19, 17, 15), [9], [8], []))))


def on_threads(monkeypatch, n_threads):
    """Residual, products and solves, on so many threads with little work each."""
    monkeypatch.setattr(cell_sums, "thread_count", lambda n: n_threads)
    monkeypatch.setattr(block_factor, "thread_count", lambda n: n_threads)
    monkeypatch.setattr(cell_sums, "PER_TASK", 100)
    monkeypatch.setattr(block_factor, "ROWS_PER_THREAD", 1)
    monkeypatch.setattr(block_factor, "ROWS_OF_LEVEL", 0.1)
    one, bar = case(), np.random.default_rng(3).standard_normal(case().states.shape)
    linearization = one.discretization.linearize(one.states, one.areas, one.stream)
    diagonal = time_terms(one.discretization, one.states, one.areas)
    factor = compact_factor(linearization, one.pattern, diagonal)
    jacobians = linearization.jacobians
    made = [
        *(blocks.copy() for blocks in (factor.lower, factor.upper, factor.pivots)),
        factor.solve(bar),
        factor.downwards(factor.upwards(bar)),
    ]
    factor = factor.into_transposed()
    return [
        *made,
        one.residual(),
        linearization.state_jvp(bar),
        linearization.state_vjp(bar),
        linearization.area_vjp(bar),
        jacobians.product(bar),
        jacobians.transposed_product(bar),
        *(factor.lower, factor.upper),
        factor.solve(bar),
        factor.downwards(factor.upwards(bar)),
    ]


@pytest.mark.parametrize("n_threads", [2, 5])
def test_residual_products_factor_and_sweeps_have_the_same_bits_on_any_number_of_threads(monkeypatch, n_threads):
    for ours, theirs in zip(on_threads(monkeypatch, n_threads), on_threads(monkeypatch, 1)):
        np.testing.assert_array_equal(ours, theirs)


def test_two_halves_of_a_solve_are_the_solve():
    factor = compact_factor(case().linearization, case().pattern, np.zeros((case().faces.n_cells, 5, 5)))
    right = np.random.default_rng(3).standard_normal(case().states.shape).astype(np.float32)
    solution = factor.solve(right)
    np.testing.assert_array_equal(factor.downwards(factor.upwards(right)), solution)
    transposed = factor.into_transposed()
    ours = transposed.downwards(transposed.upwards(right))
    np.testing.assert_array_equal(ours, transposed.solve(right))
    assert not np.array_equal(ours, solution)


def pattern_with_last(share, has_turn=True):
    """Pattern of a box of cells, some of which, at random, are its last rows."""
    faces, rng = case().faces, np.random.default_rng(8)
    sizes = rng.random(faces.n_inner) + 0.5
    left, right = faces.left[: faces.n_inner], faces.right
    diagonal = np.bincount(np.append(left, right), np.append(sizes, sizes), faces.n_cells)
    is_last = rng.random(faces.n_cells) < share
    return FactorPattern._with_last(left, right, sizes, diagonal, is_last, has_turn, 0.01)[0]


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_two_halves_need_nothing_of_each_other_and_rows_of_a_level_are_next_to_each_other(share):
    pattern = pattern_with_last(share)
    part = np.repeat(np.arange(4), np.diff(pattern.parts))
    rows = np.repeat(np.arange(len(part)), np.diff(pattern.starts))
    needed, levels = part[pattern.columns], levels_of(pattern.starts, pattern.columns)
    assert not (needed[part[rows] == 1] == 0).any()
    assert set(needed[part[rows] == 2]) == {0, 1, 2}
    assert (needed < 3).all()
    first, second, separator, last = np.diff(pattern.parts)
    assert 0.8 * second < first <= second
    assert 0 < separator < 0.15 * len(part)
    assert (last > 0) == (share > 0.0)
    for lo, hi in zip(pattern.parts, pattern.parts[1:]):
        assert (np.diff(levels[lo:hi]) >= 0).all()
    assert (levels[rows] > levels[pattern.columns]).all()


@pytest.mark.parametrize("has_turn", [True, False])
@pytest.mark.parametrize("share", [0.0, 0.05])
@pytest.mark.parametrize(("n_threads", "rows_of_level"), [(1, 1), (2, 1), (5, 1), (5, 1000)])
def test_each_row_is_in_one_chunk_that_needs_chunks_of_earlier_levels_and_its_own_earlier_rows(
    monkeypatch, has_turn, share, n_threads, rows_of_level
):
    monkeypatch.setattr(block_factor, "thread_count", lambda n: n_threads)
    monkeypatch.setattr(block_factor, "ROWS_OF_LEVEL", rows_of_level)
    pattern = pattern_with_last(share, has_turn)
    schedule, n = pattern.schedule, len(pattern.order)
    chunk, level_of_chunk = np.full(n, -1), np.repeat(np.arange(len(schedule.levels) - 1), np.diff(schedule.levels))
    for k, (first, end) in enumerate(zip(schedule.firsts, schedule.ends)):
        assert (chunk[first:end] == -1).all()
        chunk[first:end] = k
    assert (chunk >= 0).all()
    assert len(level_of_chunk) == len(schedule.firsts)
    needing, needed = chunk[np.repeat(np.arange(n), np.diff(pattern.starts))], chunk[pattern.columns]
    assert ((needing == needed) | (level_of_chunk[needing] > level_of_chunk[needed])).all()
    is_by_level = rows_of_level == 1 and n_threads > 1 + has_turn
    assert (len(schedule.firsts) > 100 and schedule.n_threads > 2) == is_by_level
    expected = ([2, 1] if has_turn else [1]) + [1] * (share > 0.0)
    assert is_by_level or np.diff(schedule.levels).tolist() == expected
    np.testing.assert_array_equal(pattern.columns[schedule.column_entries], np.sort(pattern.columns))


@njit
def end_chunk(numbers):
    finish(numbers)


LEVELS, TURN = np.array([0, 4, 9, 10, 15, 19]), 3


@pytest.mark.parametrize("n_threads", [1, 3])
def test_chunks_are_claimed_once_and_after_those_of_lower_levels(n_threads):
    numbers, order = counters(LEVELS[-1]), []

    def work(part):
        chunk, level, n_tried = claim(numbers, LEVELS, TURN, part, n_threads, 0, 0)
        while chunk >= 0:
            order.append(chunk)
            end_chunk(numbers)
            chunk, level, n_tried = claim(numbers, LEVELS, TURN, part, n_threads, level, n_tried)

    run_tasks(work, range(n_threads), n_threads)
    assert sorted(order) == list(range(LEVELS[-1]))
    levels = np.searchsorted(LEVELS, order, side="right")
    assert (np.diff(levels) >= 0).all()


def test_a_thread_begins_every_level_with_its_own_part_also_where_chunks_are_numbered_backwards():
    numbers, firsts, last, level, n_tried = counters(LEVELS[-1]), [], -1, 0, 0
    while True:
        chunk, level, n_tried = claim(numbers, LEVELS, TURN, 1, 2, level, n_tried)
        if chunk < 0:
            break
        if level != last:
            firsts.append(int(chunk - LEVELS[level]))
        last = level
        end_chunk(numbers)
    assert firsts == [2, 2, 0, 0, 0]
