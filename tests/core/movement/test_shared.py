"""Who of several processes moves; what they do together is in ``tests/parallel``."""

import importlib.util
from dataclasses import replace

import pytest
from mover_cases import channel

from bspline_mdao.base.numerics.processes import ONE
from bspline_mdao.core.movement import shared
from bspline_mdao.core.movement.shared import _placed, shared_mover
from bspline_mdao.errors import InputError
from bspline_mdao.movers import ConjugateGradients, LinearElasticity, PetscCholesky, PetscMultigrid, RadialBasis

needs_petsc = pytest.mark.skipif(not importlib.util.find_spec("petsc4py"), reason="no petsc4py")


@pytest.fixture
def elasticity():
    return LinearElasticity(channel(), n_increments=3)


def place(mover, memory=10**12, way="auto"):
    return _placed(mover, memory, 4, way)


def test_one_process_moves_as_ever(elasticity):
    assert shared_mover(elasticity, ONE, "all") is elasticity
    with pytest.raises(InputError, match="processes 'second'; give one of auto, first, all"):
        shared_mover(elasticity, ONE, "second")


@pytest.mark.slow
def test_predicted_memory_is_that_of_the_factors_that_are_kept(elasticity):
    analysis = elasticity._equilibrium.analysis
    for n_increments, keep, n_factors in ((1, None, 1), (3, None, 2), (3, True, 3), (5, True, 5)):
        mover = replace(elasticity, n_increments=n_increments, keep_factors=keep)
        assert mover.predicted_bytes() == n_factors * analysis.factor_bytes + analysis.work_bytes
    assert replace(elasticity, solver=ConjugateGradients()).predicted_bytes() is None


@needs_petsc
def test_factors_that_are_too_large_for_one_process_are_shared(elasticity, monkeypatch):
    needed = elasticity.predicted_bytes()
    for available, memory, solver in (
        (2 * needed, 0, None),
        (2 * needed - 2, 4 * needed, PetscCholesky()),
        (2 * needed - 2, 2 * needed, PetscMultigrid()),
    ):
        monkeypatch.setattr(shared, "available_bytes", lambda available=available: available)
        placement, chosen = place(elasticity, memory)
        assert chosen == (solver or elasticity.solver)
        assert str(placement).startswith("on all 4 processes (" if solver else "on the first of 4 processes (")
        assert "GB, " in placement.why


def test_one_line_says_what_is_missing_where_all_have_to_move(elasticity, monkeypatch):
    monkeypatch.setattr(shared, "has_petsc", lambda: False)
    assert place(elasticity, way="first")[0].way == "first"
    with pytest.raises(InputError, match="petsc4py is not installed; install it"):
        place(elasticity, way="all")


def test_serial_movers_and_solvers_say_so(elasticity):
    assert "RadialBasis shares no system" in place(RadialBasis(channel()))[0].why
    assert "CG, ILU(1) has no parallel form" in place(replace(elasticity, solver=ConjugateGradients()))[0].why
    with pytest.raises(InputError, match="RadialBasis shares no system"):
        place(RadialBasis(channel()), way="all")
