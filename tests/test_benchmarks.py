"""Benchmarks find what they measure."""

import runpy
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def loaded(monkeypatch):
    """Names of a benchmark, which is not run."""
    monkeypatch.setattr(sys, "path", [str(FOLDER), *sys.path])
    return lambda name: runpy.run_path(str(FOLDER / f"{name}.py"), run_name=name)


@pytest.mark.parametrize("name", sorted(path.stem for path in FOLDER.glob("bench_*.py")))
def test_a_benchmark_imports_names_that_are_there(loaded, name):
    assert "main" in loaded(name)


@pytest.mark.slow
def test_a_flow_and_its_adjoint_are_measured(loaded):
    measured = loaded("bench_euler")["measure"](5_376)
    assert measured["is_converged"] == {"flow": True, "adjoint": True}
    assert min(measured["cpu"].values()) > 0.0


@pytest.mark.slow
def test_steps_of_an_optimiser_are_measured(loaded):
    results = loaded("bench_flow_steps")["main"](5_376)
    assert results["cold"]["products"] > max(each["step"]["products"] for each in results["steps"].values()) > 0
    errors = [each["error"] for each in results["tolerances"].values()]
    assert errors == sorted(errors)
