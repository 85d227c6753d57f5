"""Settings of Newton's method: in one place, given from outside, and few other numbers beside them."""

import ast
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import numpy as np
import pytest

import bspline_mdao
from bspline_mdao.flow.euler import cold_start, sequencing
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.newton import FlowSolution
from bspline_mdao.flow.euler.newton_step import NewtonStep
from bspline_mdao.flow.euler.settings import NEWTON, STARTS

EULER = Path(bspline_mdao.__file__).parent / "flow" / "euler"


def is_number(node):
    """Whether a value is made of numbers."""
    match node:
        case ast.Constant():
            return isinstance(node.value, int | float) and not isinstance(node.value, bool)
        case ast.UnaryOp():
            return is_number(node.operand)
        case ast.BinOp():
            return is_number(node.left) or is_number(node.right)
        case ast.Tuple():
            return any(map(is_number, node.elts))
    return False


def numeric_constants(source):
    """Names in capitals that a module gives numbers, two in ``A, B = 1, 2``."""
    for node in ast.parse(source).body:
        if not isinstance(node, ast.Assign):
            continue
        (target,) = node.targets
        is_pair = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
        pairs = zip(target.elts, node.value.elts) if is_pair else [(target, node.value)]
        for name, value in pairs:
            if isinstance(name, ast.Name) and name.id.isupper() and is_number(value):
                yield name.id


def test_constants_are_counted():
    assert list(numeric_constants("A, _B = 1, -2.0\nC = 3.0 / A\nd = 4\nE = 'x'\nF = (1, 2)\n")) == [
        "A",
        "_B",
        "C",
        "F",
    ]


def test_modules_of_the_flow_have_no_more_than_sixty_numeric_constants():
    found = {path.name: list(numeric_constants(path.read_text())) for path in EULER.glob("*.py")}
    assert sum(map(len, found.values())) <= 60, {name: names for name, names in found.items() if names}


def test_settings_cannot_be_changed_for_all():
    for settings in (NEWTON, STARTS):
        with pytest.raises(FrozenInstanceError):
            settings.hard = settings.stalled = 1


def test_starts_hand_the_settings_of_newton_steps_to_every_member_and_the_grid(monkeypatch):
    settings = replace(STARTS, member_tolerance=0.02, newton=replace(NEWTON, first_cfl=7.0))
    seen = []

    def record(discretization, areas, stream, *, settings, states=None, tolerance=1e-10, **how):
        seen.append((settings.first_cfl, tolerance))
        history = NewtonStep(1e-4, 1.0, 1, 1.0), NewtonStep(1e-12, 1.0, 1, 1.0)
        return FlowSolution(np.zeros((0, 5)), stream, history, tolerance)

    class Level:
        class flow:
            discretization = pattern = None
            areas = staticmethod(lambda nodes: None)
            at = staticmethod(lambda nodes: None)

        pick = staticmethod(lambda nodes: nodes)
        spread = staticmethod(lambda states: states)

    for module in (cold_start, sequencing):
        monkeypatch.setattr(module, "solve_flow", record)
    monkeypatch.setattr(cold_start, "_is_flat", lambda *arguments: False)
    stream = free_stream(0.3, 0.0, np.eye(3))
    next(cold_start.cold_solutions(Level.flow, [Level, Level], None, None, stream, settings=settings))
    assert seen == [(7.0, 0.02), (7.0, 0.02), (7.0, 1e-10)]
