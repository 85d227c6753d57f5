import numpy as np
import pytest
from evaluation_cases import ORDERS, mixed_volume, random_mesh, random_parameters

from bspline_mdao.errors import InputError
from bspline_mdao.evaluation.metrics import CHUNK_NODES, MappingGradients
from bspline_mdao.splines.mesh import BSplineMesh
from bspline_mdao.splines.volume import evaluate, evaluate_gradients


@pytest.mark.parametrize("orders", ORDERS)
def test_metrics_are_the_gradients_of_the_volumes(orders):
    rng = np.random.default_rng(sum(orders))
    mesh = random_mesh(rng, orders, n_volumes=2)
    parameters = [random_parameters(rng, n, orders) for n in (41, 63)]
    b = rng.standard_normal((mesh.n_control_points, 3))
    for got, volume, ids, p in zip(
        MappingGradients(mesh, parameters).forward(b), mesh.volumes, mesh.control_ids, parameters
    ):
        np.testing.assert_allclose(got, evaluate_gradients(volume, b[ids], p), rtol=1e-11, atol=1e-11)


def mixed_case(n, n_threads=None):
    volume = mixed_volume()
    mesh = BSplineMesh((volume,), (np.arange(6 * 4 * 6).reshape(6, 4, 6),), 6 * 4 * 6)
    parameters = np.random.default_rng(2).uniform(0.02, 0.98, (n, 3))
    return MappingGradients(mesh, [parameters], n_threads)


def test_metrics_are_derivatives_of_the_points():
    gradients = mixed_case(200)
    volume, p = gradients.mesh.volumes[0], gradients.parameters[0]
    b = np.random.default_rng(3).standard_normal((6, 4, 6, 3))
    h = 1e-6
    for m in range(3):
        step = h * np.eye(3)[m]
        difference = (evaluate(volume, b, p + step) - evaluate(volume, b, p - step)) / (2 * h)
        # the knot of multiplicity p - 1 makes a kink in the third parameter
        away = np.abs(p[:, 2] - 0.3) > 2 * h
        exact = gradients.forward(b.reshape(-1, 3))[0][:, :, m]
        np.testing.assert_allclose(exact[away], difference[away], rtol=0, atol=1e-7)


def test_reverse_is_the_transpose_of_forward():
    gradients = mixed_case(500)
    rng = np.random.default_rng(4)
    b, bar = rng.standard_normal((gradients.mesh.n_control_points, 3)), rng.standard_normal((500, 3, 3))
    forward = gradients.forward(b)[0] * bar
    assert abs(forward.sum() - (b * gradients.adjoint([bar])).sum()) < 1e-13 * np.abs(forward).sum()


def test_results_do_not_depend_on_the_number_of_threads():
    one, two = (mixed_case(3 * CHUNK_NODES + 5, n_threads) for n_threads in (1, 2))
    b = np.random.default_rng(5).standard_normal((one.mesh.n_control_points, 3))
    x = one.forward(b)
    np.testing.assert_array_equal(x[0], two.forward(b)[0])
    np.testing.assert_array_equal(one.adjoint(x), two.adjoint(x))


def test_bad_arguments_are_refused_in_one_line():
    gradients = mixed_case(5)
    with pytest.raises(InputError, match="parameters of volume 1"):
        MappingGradients(gradients.mesh, [np.zeros((4, 2))])
    with pytest.raises(InputError, match="1 volumes and parameters for 2"):
        MappingGradients(gradients.mesh, [np.zeros((4, 3))] * 2)
    with pytest.raises(InputError, match="control points of shape"):
        gradients.forward(np.zeros((4, 3)))
    with pytest.raises(InputError, match="derivatives of shape"):
        gradients.adjoint([np.zeros((4, 3, 3))])
