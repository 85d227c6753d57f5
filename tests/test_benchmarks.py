"""Benchmarks find what they measure."""

import runpy
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"
NAMES = sorted(path.stem for path in FOLDER.rglob("bench_*.py"))


@pytest.fixture
def loaded(monkeypatch):
    """Names of a benchmark, which is not run."""

    def load(name: str) -> dict:
        (file,) = FOLDER.glob(f"*/{name}.py")
        monkeypatch.setattr(sys, "path", [str(file.parent), *sys.path])
        return runpy.run_path(str(file), run_name=name)

    return load


def test_benchmarks_lie_in_the_folders_of_the_layers():
    layers = {path.parent.name for path in (FOLDER.parent / "bspline_mdao").glob("*/__init__.py")}
    assert NAMES
    assert {path.parent.name for path in FOLDER.rglob("*.py")} - {FOLDER.name} <= layers


@pytest.mark.parametrize("name", NAMES)
def test_a_benchmark_imports_names_that_are_there(loaded, name):
    assert "main" in loaded(name)


def test_an_extrusion_is_measured(loaded):
    (found,) = loaded("bench_extrusion")["main"]([6], [24]).values()
    assert found["n_nodes"] == 6 * 6 * 6 * 25
    assert found["n_inverted"] == 0
    assert found["heights"] > 0.8


def test_a_first_start_beyond_its_budget_is_named(loaded):
    bench = loaded("bench_cold_start")
    assert set(bench["BUDGETS"]) == set(bench["CALLS"]) >= set(bench["ASKED"])
    within = {name: {"compiled": n, "first": seconds} for name, (n, seconds) in bench["BUDGETS"].items()}
    assert bench["beyond"](within) == []
    more = {name: {"compiled": row["compiled"] + 1, "first": row["first"] + 1.0} for name, row in within.items()}
    said = bench["beyond"](more)
    assert len(said) == 2 * len(more)
    n, seconds = bench["BUDGETS"]["fit"]
    assert said[0] == f"fit compiles {n + 1} specialisations of kernels, {n} are allowed"
    assert said[1] == f"first fit takes {seconds + 1:.1f} s of CPU, {seconds:.0f} are allowed"
    assert bench["beyond"]({"imports": 1.0}) == []


def test_a_first_start_runs_the_program_of_the_page_on_python_without_its_picture(loaded):
    example = loaded("bench_cold_start")["example"]()
    compile(example, "example.py", "exec")
    assert "run_driver()" in example
    assert "plot" not in example


@pytest.mark.slow
def test_what_a_first_start_compiles_is_counted(loaded):
    results = loaded("bench_cold_start")["main"](["quality"], again=False)
    assert results["quality"]["compiled"] > 10
    assert results["quality"]["first"] > results["imports"] > 0.0


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
