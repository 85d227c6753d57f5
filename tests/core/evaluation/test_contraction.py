"""The plain kernels beside the emitted ones: the same numbers to round-off, and when they are taken."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from evaluation_cases import cloud, random_mesh

from bspline_mdao.core.evaluation import contraction
from bspline_mdao.core.evaluation.nodes_by_span import turned_forward_kernel, turned_reverse_kernel

TESTS = Path(__file__).parents[2]


def results() -> dict[str, np.ndarray]:
    """All that the kernels of this process make of seeded input."""
    out = {}
    for orders in ((2, 3, 4), (1, 1, 3)):
        rng = np.random.default_rng(sum(orders))
        evaluator = cloud(rng, random_mesh(rng, orders, n_volumes=2), 157)[0]
        b, bar = rng.standard_normal((evaluator.n_control_points, 3)), rng.standard_normal((evaluator.n_rows, 3))
        matrix = evaluator.matrix().toarray()
        out |= {f"{orders} forward": evaluator.forward(b), f"{orders} adjoint": evaluator.adjoint(bar)}
        out[f"{orders} matrix"] = matrix
    turned, turned_bars, rotations_bar = turned_results()
    return out | {"turned": turned, "turned adjoint": turned_bars, "rotations": rotations_bar}


def turned_results():
    """Nodes with turned vectors, and the transpose: vectors, fractions and rotations do not depend on the storage."""
    rng = np.random.default_rng(5)
    evaluator = cloud(rng, random_mesh(rng, (2, 3, 4)), 157)[0]  # orders of `results`, whose kernels are compiled
    (nodes,) = evaluator.nodes
    n_spans, scratch = len(nodes.anchors), 8
    b, bar = rng.standard_normal((evaluator.n_control_points, 3)), rng.standard_normal((evaluator.n_rows, 3)).ravel()
    corners = rng.integers(0, 20, (n_spans, 8)).astype(np.int32)
    matrices, vector, place = rng.standard_normal((20, 9)), rng.standard_normal(3), rng.random(3).astype(np.float32)
    fractions = np.zeros(3 * nodes.n_nodes + scratch, dtype=np.float32)
    vectors = np.zeros(3 * nodes.n_nodes + scratch)
    for first, last in zip(nodes.starts[:-1], nodes.starts[1:]):
        for group in range(first, last, contraction.LANES):
            n = min(contraction.LANES, last - group)
            for d in range(3):  # the same for all nodes, so that the width of groups does not matter
                fractions[3 * group + d * n : 3 * group + (d + 1) * n] = place[d]
                vectors[3 * group + d * n : 3 * group + (d + 1) * n] = vector[d]
    net, out = b[evaluator.control_ids[0]].reshape(-1), np.zeros(3 * evaluator.n_rows)
    arrays = nodes.arrays
    turned_forward_kernel(*nodes.orders)(0, n_spans, *arrays, net, fractions, vectors, corners, matrices, out)
    net_bar, turns = np.zeros_like(net), np.zeros((n_spans, 8, 9))
    turned_reverse_kernel(*nodes.orders)(0, n_spans, *arrays, bar, fractions, vectors, turns, 0, net_bar)
    return out, net_bar, turns


@pytest.mark.slow
def test_plain_kernels_agree_with_the_emitted_ones_to_round_off(tmp_path):
    program = f"""
import sys
import numpy as np
sys.path[:0] = [{str(TESTS)!r}, {str(TESTS / "core" / "evaluation")!r}]
from test_contraction import contraction, results
assert not contraction.IS_EMITTED
np.savez(sys.argv[1], **results())
"""
    file = tmp_path / "plain.npz"
    environment = os.environ | {contraction.VARIABLE: "1"}
    subprocess.run([sys.executable, "-W", "error", "-c", program, file], env=environment, check=True)
    assert contraction.IS_EMITTED
    plain, emitted = np.load(file), results()
    assert set(plain) == set(emitted)
    for name, expected in emitted.items():
        np.testing.assert_allclose(plain[name], expected, rtol=0, atol=5e-15 * np.abs(expected).max(), err_msg=name)


@pytest.mark.parametrize("version", ["0.60.2", "0.69.0rc1", "1.0.0"])
def test_versions_that_the_emitted_code_was_not_tested_with_get_the_plain_kernels(version):
    assert version in contraction.why_plain(version)


def test_the_installed_version_gets_the_emitted_code_unless_its_trial_fails(monkeypatch):
    assert contraction.why_plain(numba.__version__) is None
    monkeypatch.delattr("llvmlite.ir.IRBuilder.shuffle_vector")
    assert "does not emit vector code (AttributeError" in contraction.why_plain()
    with pytest.warns(RuntimeWarning, match="plain kernels are used"):
        assert not contraction._is_emitted()


def test_the_ceiling_on_numba_is_that_of_the_emitted_code():
    (low, high) = contraction.TESTED
    requirement = f'"numba>={low[0]}.{low[1]},<{high[0]}.{high[1]}"'
    assert requirement in (TESTS.parent / "pyproject.toml").read_text()
