"""The run scripts with JAX, PyTorch and SMT: a better wing, proposals without bad cells, a surrogate that is near."""

import importlib
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


def assert_drawn(path):
    assert path.stat().st_size > 5_000


def test_descent_on_a_flow_model_of_jax_takes_a_bad_twist_away(script, tmp_path):
    jax = pytest.importorskip("jax", reason="JAX is not installed")
    before = jax.config.jax_enable_x64
    try:
        numbers = script("jax_descent").main(figures=tmp_path)
    finally:
        jax.config.update("jax_enable_x64", before)
    assert numbers["efficiency"]["start"] < 0.95
    assert 1.0 < numbers["efficiency"]["end"] < 1.03  # a lattice of 24 strips flatters by some 2 %
    assert numbers["history"] == sorted(numbers["history"], reverse=True)
    assert numbers["inverted"] == 0
    assert_drawn(tmp_path / "jax_descent.png")


def test_a_network_that_is_trained_through_validity_proposes_better_cells(script, tmp_path):
    pytest.importorskip("torch", reason="PyTorch is not installed")
    numbers = script("torch_designer").main(figures=tmp_path)
    for found in numbers.values():
        assert found["losses"][1] < 0.5 * found["losses"][0]
    assert numbers["with_cells"]["inverted"] == 0 < numbers["without"]["inverted"]
    assert numbers["with_cells"]["worst_corner"] > 0.0 > numbers["without"]["worst_corner"]
    assert_drawn(tmp_path / "torch_designer.png")


def test_a_surrogate_with_gradients_is_much_better_on_designs_that_it_has_not_seen(script, tmp_path):
    pytest.importorskip("smt", reason="SMT is not installed")
    numbers = script("surrogate_of_designs").main(figures=tmp_path)
    assert numbers["designs"] == 16
    assert numbers["refused"] == 0
    assert numbers["errors"]["with_gradients"] < 0.05 < numbers["errors"]["without"]
    assert_drawn(tmp_path / "surrogate_of_designs.png")
