"""B-spline curves, Eq. (1), and one-dimensional meshes, section II.B.

Theory: ``docs/theory/splines.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...base.display import OneLine
from ...errors import InputError
from .knots import ConstantKnots
from .volume import Volume, evaluate, evaluate_gradients


@dataclass(frozen=True, eq=False)
class Curve(OneLine):
    """A B-spline curve; a mapping of [0, 1] to an interval where its control points have one coordinate.

    Parameters
    ----------
    control_points : ndarray, shape (N, d)
        Control points.
    knots : ConstantKnots
        Knots, which carry the order.

    Examples
    --------
    >>> from bspline_mdao.splines import Curve
    >>> curve = Curve.uniform([[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]], order=3)
    >>> curve([0.0, 0.5])
    array([[0., 0.],
           [1., 1.]])
    """

    control_points: np.ndarray
    knots: ConstantKnots

    def __post_init__(self) -> None:
        points = np.array(self.control_points, dtype=float)
        if points.ndim != 2 or len(points) != self.knots.n_control:
            raise InputError(f"curve: control points of shape {points.shape}; give ({self.knots.n_control}, d)")
        object.__setattr__(self, "control_points", points)

    @classmethod
    def uniform(cls, control_points: np.ndarray, order: int = 4) -> Curve:
        """Make a curve with evenly spaced inner knots."""
        return cls(control_points, ConstantKnots.uniform(len(control_points), order))

    def __call__(self, xi: ArrayLike) -> np.ndarray:
        """Points at the parameters ``xi``, shape (n,); returns shape (n, d)."""
        return evaluate(*self._as_volume(), _on_the_curve(xi))

    def derivative(self, xi: ArrayLike) -> np.ndarray:
        """First derivatives at the parameters ``xi``, shape (n,); returns shape (n, d)."""
        return evaluate_gradients(*self._as_volume(), _on_the_curve(xi))[..., 0]

    def _as_volume(self) -> tuple[Volume, np.ndarray]:
        return Volume.of(self.knots), self.control_points[:, None, None]


def _on_the_curve(xi: ArrayLike) -> np.ndarray:
    """Parameters of a volume whose other two directions are degenerate."""
    return np.asarray(xi, dtype=float)[:, None] * [1.0, 0.0, 0.0]


def uniform_parameters(curve: Curve, n: int) -> np.ndarray:
    """Parameters whose image is a uniform one-dimensional mesh, section II.B.

    Parameters
    ----------
    curve : Curve
        A curve with one coordinate and strictly monotone control points, hence itself strictly monotone.
    n : int
        Number of mesh points, at least 2.

    Returns
    -------
    ndarray, shape (n,)
        Increasing from 0 to 1.

    Raises
    ------
    InputError
        If the curve is not monotone, or n is below 2.

    Examples
    --------
    >>> from bspline_mdao.splines import Curve, uniform_parameters
    >>> curve = Curve.uniform([[0.0], [1.0], [2.0], [3.0], [4.0]], order=3)
    >>> curve(uniform_parameters(curve, 5)).ravel().round(12)
    array([0., 1., 2., 3., 4.])
    """
    # Uniform control points, knots and parameters do not give a uniform mesh, because the basis functions near the ends
    # are not symmetric. This change of parameter makes it uniform.
    steps = np.diff(curve.control_points, axis=0)
    if steps.shape[1] != 1 or not (np.all(steps > 0) or np.all(steps < 0)):
        raise InputError("uniform parameters: a curve that is not monotone; give one increasing coordinate")
    if n < 2:
        raise InputError(f"uniform parameters: {n} mesh points; ask for at least 2")
    xi = _invert(curve, np.linspace(curve.control_points[0, 0], curve.control_points[-1, 0], n))
    xi[[0, -1]] = 0.0, 1.0
    return xi


def _invert(curve: Curve, x: np.ndarray) -> np.ndarray:
    """Solve ``curve(xi) = x`` of a monotone curve by bisection, which is robust to kinks and flat stretches."""
    low, high = np.zeros_like(x), np.ones_like(x)
    sign = np.sign(curve.control_points[-1, 0] - curve.control_points[0, 0])
    for _ in range(np.finfo(float).nmant + 2):
        middle = 0.5 * (low + high)
        is_past = sign * (curve(middle)[:, 0] - x) > 0
        low, high = np.where(is_past, low, middle), np.where(is_past, middle, high)
    return 0.5 * (low + high)
