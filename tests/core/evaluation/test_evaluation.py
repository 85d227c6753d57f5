import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from evaluation_cases import ORDERS, cloud, mixed_volume, random_mesh, random_parameters, random_volume
from numba.core.errors import TypingError

from bspline_mdao.core.evaluation.contraction import LANES, SOURCE
from bspline_mdao.core.evaluation.evaluator import CHUNK_NODES, Evaluator
from bspline_mdao.core.evaluation.nodes_by_span import forward_kernel, reverse_kernel, sort_nodes
from bspline_mdao.core.splines.knots import ConstantKnots
from bspline_mdao.core.splines.mesh import BSplineMesh
from bspline_mdao.core.splines.volume import Volume, evaluate
from bspline_mdao.errors import InputError
from bspline_mdao.testing import dot_test


def transposed(evaluator):
    """How far products with the evaluator's transpose are from those of a transpose."""
    return dot_test(evaluator.forward, evaluator.adjoint, (evaluator.n_control_points, 3), (evaluator.n_rows, 3))


@pytest.mark.slow
@pytest.mark.parametrize("orders", ORDERS)
def test_nodes_are_those_of_the_volumes(orders):
    rng = np.random.default_rng(sum(orders))
    mesh = random_mesh(rng, orders, n_volumes=2)
    evaluator, parameters, rows, copies = cloud(rng, mesh, 157)
    b = rng.standard_normal((mesh.n_control_points, 3))
    x = evaluator.forward(b)
    for volume, ids, p, r in zip(mesh.volumes, mesh.control_ids, parameters, rows):
        np.testing.assert_allclose(x[r], evaluate(volume, b[ids], p), rtol=0, atol=2e-14)
    np.testing.assert_array_equal(x[copies[:, 0]], x[copies[:, 1]])


@pytest.mark.slow
@pytest.mark.parametrize("orders", ORDERS)
def test_reverse_is_the_transpose_of_forward(orders):
    rng = np.random.default_rng(sum(orders))
    evaluator = cloud(rng, random_mesh(rng, orders, n_volumes=2), 157)[0]
    assert transposed(evaluator) < 1e-14


@pytest.mark.parametrize("orders", ORDERS)
def test_matrix_is_the_same_map(orders):
    rng = np.random.default_rng(sum(orders))
    mesh = random_mesh(rng, orders, n_volumes=2)
    evaluator = cloud(rng, mesh, 57)[0]
    matrix = evaluator.matrix()
    b, x = rng.standard_normal((mesh.n_control_points, 3)), rng.standard_normal((evaluator.n_rows, 3))
    assert matrix.has_canonical_format
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, rtol=0, atol=1e-14)
    np.testing.assert_allclose(matrix @ b, evaluator.forward(b), rtol=0, atol=2e-14)
    np.testing.assert_allclose(matrix.T @ x, evaluator.adjoint(x), rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 2, LANES - 1, LANES, LANES + 1, 2 * LANES, 255, 256, 257, 521])
def test_spans_of_every_number_of_nodes_are_evaluated(n):
    rng = np.random.default_rng(n)
    mesh = random_mesh(rng, (4, 3, 4), extra=0)
    rows = rng.permutation(n)
    parameters = rng.uniform(0, 0.5, (n, 3))
    evaluator = Evaluator.build(mesh, [parameters], [rows], n)
    b = rng.standard_normal((mesh.n_control_points, 3))
    expected = evaluate(mesh.volumes[0], b[mesh.control_ids[0]], parameters)
    np.testing.assert_allclose(evaluator.forward(b)[rows], expected, rtol=0, atol=2e-14)
    assert transposed(evaluator) < 1e-14


def test_every_kind_of_knots_is_evaluated():
    rng = np.random.default_rng(3)
    volume = mixed_volume()
    mesh = BSplineMesh((volume,), (rng.permutation(np.prod(volume.n_control)).reshape(volume.n_control),), 6 * 4 * 6)
    evaluator, parameters, rows, _ = cloud(rng, mesh, 5000)
    b = rng.standard_normal((mesh.n_control_points, 3))
    expected = evaluate(volume, b[mesh.control_ids[0]], parameters[0])
    np.testing.assert_allclose(evaluator.forward(b)[rows[0]], expected, rtol=0, atol=2e-14)


def large_case(n_threads):
    rng = np.random.default_rng(7)
    mesh = random_mesh(rng, (4, 4, 3), n_volumes=2)
    return cloud(rng, mesh, 2 * CHUNK_NODES + 77, n_threads)[0]


@pytest.mark.slow
def test_results_do_not_depend_on_the_number_of_threads():
    one = large_case(1)
    assert len(one.chunks) > 4
    b = np.random.default_rng(8).standard_normal((one.n_control_points, 3))
    x = one.forward(b)
    bar = one.adjoint(x)
    for n_threads in (2, 3, 7):
        np.testing.assert_array_equal(one.with_threads(n_threads).forward(b), x)
        np.testing.assert_array_equal(one.with_threads(n_threads).adjoint(x), bar)


def test_threads_of_the_user_may_call_at_the_same_time():
    evaluator = large_case(2)
    b = np.random.default_rng(8).standard_normal((evaluator.n_control_points, 3))
    expected = evaluator.forward(b)
    with ThreadPoolExecutor(4) as pool:
        for result in pool.map(lambda scale: evaluator.forward(scale * b), [1.0, 2.0, 4.0, 8.0] * 2):
            np.testing.assert_array_equal(result / np.abs(result).max(), expected / np.abs(expected).max())


def test_a_coordinate_that_all_control_points_share_keeps_its_bits():
    rng = np.random.default_rng(11)
    mesh = random_mesh(rng, (4, 5, 3))
    evaluator = cloud(rng, mesh, 300)[0]
    b = rng.standard_normal((mesh.n_control_points, 3))
    b[:, 1] = 0.1
    np.testing.assert_array_equal(evaluator.forward(b)[:, 1], 0.1)


@pytest.mark.parametrize("extra", [0, 3])
def test_nodes_of_a_face_depend_on_its_control_points_alone(extra):
    rng = np.random.default_rng(12)
    mesh = random_mesh(rng, (4, 3, 5), extra=extra)
    parameters = random_parameters(rng, 200)
    evaluator = Evaluator.build(mesh, [parameters], [np.arange(200)], 200)
    ids = mesh.control_ids[0]
    for d in range(3):
        for end in (0, -1):
            b = rng.standard_normal((mesh.n_control_points, 3))
            other = rng.standard_normal(b.shape)
            face = np.take(ids, end, axis=d)
            other[face] = b[face]
            on_face = parameters[:, d] == -end
            assert on_face.sum() > 8
            np.testing.assert_array_equal(evaluator.forward(b)[on_face], evaluator.forward(other)[on_face])


def test_corners_are_control_points_to_the_last_bit():
    rng = np.random.default_rng(13)
    mesh = random_mesh(rng, (4, 4, 4))
    ends = np.stack(np.meshgrid([0, -1], [0, -1], [0, -1], indexing="ij"), -1).reshape(-1, 3)
    evaluator = Evaluator.build(mesh, [-1.0 * ends], [np.arange(8)], 8)
    b = rng.standard_normal((mesh.n_control_points, 3))
    np.testing.assert_array_equal(evaluator.forward(b), b[mesh.control_ids[0][tuple(ends.T)]])


def test_shared_and_collapsed_control_points_are_summed():
    rng = np.random.default_rng(14)
    volume = random_volume(rng, (4, 3, 4), (5, 4, 6))
    ids = np.arange(5 * 4 * 6).reshape(5, 4, 6)
    ids[0, :, :] = ids[0, :1, :]  # a collapsed face
    ids = np.unique(ids, return_inverse=True)[1].reshape(5, 4, 6)
    mesh = BSplineMesh((volume, volume), (ids, ids[::-1, :, ::-1]), int(ids.max()) + 1)
    evaluator = cloud(rng, mesh, 300)[0]
    b, x = rng.standard_normal((mesh.n_control_points, 3)), rng.standard_normal((evaluator.n_rows, 3))
    assert transposed(evaluator) < 1e-14
    np.testing.assert_allclose(evaluator.matrix() @ b, evaluator.forward(b), rtol=0, atol=2e-14)
    np.testing.assert_allclose(evaluator.matrix().T @ x, evaluator.adjoint(x), rtol=0, atol=1e-12)


def test_rows_that_are_no_node_are_zero():
    rng = np.random.default_rng(15)
    mesh = random_mesh(rng, (3, 3, 3))
    evaluator = Evaluator.build(mesh, [rng.uniform(0, 1, (5, 3))], [np.array([9, 2, 4, 0, 7])], 11)
    x = evaluator.forward(rng.standard_normal((mesh.n_control_points, 3)))
    np.testing.assert_array_equal(np.flatnonzero((x == 0).all(axis=1)), [1, 3, 5, 6, 8, 10])
    assert transposed(evaluator) < 1e-14


def test_result_can_be_written_to_an_array():
    rng = np.random.default_rng(16)
    mesh = random_mesh(rng, (4, 4, 4))
    evaluator = cloud(rng, mesh, 100)[0]
    b, out = rng.standard_normal((mesh.n_control_points, 3)), np.full((evaluator.n_rows, 3), np.nan)
    assert evaluator.forward(b, out) is out
    np.testing.assert_array_equal(out, evaluator.forward(b))


def test_complex_step_is_exact():
    rng = np.random.default_rng(17)
    mesh = random_mesh(rng, (4, 4, 4))
    evaluator = cloud(rng, mesh, 100)[0]
    b, direction = rng.standard_normal((2, mesh.n_control_points, 3))
    np.testing.assert_allclose(
        evaluator.forward(b + 1e-200j * direction).imag / 1e-200, evaluator.forward(direction), atol=1e-14
    )
    x = rng.standard_normal((evaluator.n_rows, 3))
    np.testing.assert_array_equal(evaluator.adjoint(x + 2j * x), evaluator.adjoint(x) + 1j * evaluator.adjoint(2 * x))


def test_memory_is_below_128_bytes_per_node():
    axes = [np.linspace(0, 1, n) for n in (23, 33, 17)]
    parameters = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    knots = [ConstantKnots.uniform(n, 4) for n in (8, 8, 6)]
    mesh = BSplineMesh((Volume(tuple(knots)),), (np.arange(8 * 8 * 6).reshape(8, 8, 6),), 8 * 8 * 6)
    evaluator = Evaluator.build(mesh, [parameters], [np.arange(len(parameters))], len(parameters))
    assert 76 <= evaluator.bytes_per_node < 80


def test_nodes_of_a_span_share_a_sub_net():
    rng = np.random.default_rng(18)
    volume = random_volume(rng, (4, 3, 2), (7, 5, 4))
    nodes = sort_nodes(volume, random_parameters(rng, 500), np.arange(500), np.empty((0, 2), dtype=int))
    assert nodes.n_nodes == 500
    assert (np.diff(nodes.anchors) > 0).all()
    np.testing.assert_array_equal(np.sort(nodes.rows[:500]), np.arange(500))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": [np.array([0, 1, 1])]}, "row 2 is given twice"),
        ({"rows": [np.array([0, 1, 3])]}, "outside 0 .. 2"),
        ({"rows": [np.array([0, 1])]}, "volume 1 has parameters of shape"),
        ({"rows": []}, "one array of each per volume"),
        ({"parameters": [np.array([[0, 0, 0], [0, np.nan, 0], [0, 0, 0.0]])]}, "point 2 of volume 1 are not finite"),
        ({"copies": np.array([[2, 0]])}, "row 3 is given twice"),
        ({"rows": [np.array([0, 1, 4])], "n_rows": 5, "copies": np.array([[2, 3]])}, "row 3 copies row 4"),
        ({"copies": np.array([2, 0])}, "copies of shape"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(change, message):
    mesh = random_mesh(np.random.default_rng(19), (2, 2, 2))
    arguments = {"parameters": [np.zeros((3, 3))], "rows": [np.arange(3)], "n_rows": 3, "copies": None} | change
    with pytest.raises(InputError, match=message):
        Evaluator.build(mesh, **arguments)


def test_arrays_of_wrong_shape_are_refused():
    evaluator = cloud(np.random.default_rng(20), random_mesh(np.random.default_rng(20), (2, 2, 2)), 10)[0]
    b = np.zeros((evaluator.n_control_points, 3))
    for call in (
        lambda: evaluator.forward(b.ravel()),
        lambda: evaluator.forward(b, np.zeros((3, 3))),
        lambda: evaluator.adjoint(b[:1]),
    ):
        with pytest.raises(InputError, match="shape"):
            call()


@pytest.mark.slow
def test_a_second_process_does_not_compile_again():
    program = """
import numba.core.compiler, numpy as np, sys
sys.path.insert(0, "tests")
from evaluation_cases import cloud, random_mesh
compiled = []
run = numba.core.compiler.CompilerBase.compile_extra
def count(self, func):
    compiled.append(func.__qualname__)
    return run(self, func)
numba.core.compiler.CompilerBase.compile_extra = count
rng = np.random.default_rng(0)
evaluator = cloud(rng, random_mesh(rng, (4, 4, 4)), 50)[0]
evaluator.adjoint(evaluator.forward(np.zeros((evaluator.n_control_points, 3))))
print(compiled)
"""
    results = [
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True) for _ in range(2)
    ]
    assert results[1].stdout.strip() == "[]"


@pytest.mark.slow
def test_orders_may_be_numpy_integers():
    degenerate, knots = ConstantKnots.uniform(1, 1), ConstantKnots.uniform(n_control=np.int64(5), order=np.int32(5))
    mesh = BSplineMesh((Volume((degenerate, degenerate, knots)),), (np.arange(5).reshape(1, 1, 5),), 5)
    evaluator = Evaluator.build(mesh, [np.array([[0.0, 0, 0], [0, 0, 1.0]])], [np.arange(2)], n_rows=2)
    np.testing.assert_array_equal(evaluator.forward(np.eye(5, 3)), [[1, 0, 0], [0, 0, 0]])


def test_orders_that_are_no_constants_are_refused_by_name():
    kernel = forward_kernel.__wrapped__(np.int64(2), 2, 2)  # not the one that others share
    evaluator = cloud(np.random.default_rng(0), random_mesh(np.random.default_rng(0), (2, 2, 2)), 5)[0]
    with pytest.raises(TypingError, match=r"orders .* must be Python integers"):
        kernel(0, 0, *evaluator.nodes[0].arrays, np.zeros(0), np.zeros(0))


@pytest.mark.parametrize("kernel", [forward_kernel, reverse_kernel])
def test_kernels_are_cached_by_the_orders_and_the_source_of_their_intrinsics(kernel):
    first, second = ([cell.cell_contents for cell in kernel(*p).py_func.__closure__] for p in ((2, 3, 4), (4, 3, 2)))
    assert first != second  # numba's key holds the closure in order
    assert SOURCE in first
    assert SOURCE in second
