"""Derivatives of plain functions: differences, complex steps, dot tests and the order of Taylor remainders."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..errors import InputError

__all__ = ["central_difference", "central_differences", "complex_step", "dot_test", "richardson", "taylor_rate"]


def richardson(values: Sequence[np.ndarray]) -> np.ndarray:
    """Extrapolate values at halved steps, whose errors are even powers of the step, to a step of zero.

    Parameters
    ----------
    values : sequence of float or ndarray
        Values at steps ``h``, ``h / 2``, ``h / 4`` and so on, such as central differences.

    Returns
    -------
    float or ndarray
        Their limit. With n values the error is of order ``2 n`` in the step.

    Raises
    ------
    InputError
        If there is no value.

    Examples
    --------
    >>> from bspline_mdao.testing import richardson
    >>> [float(richardson([1.0 + h**2 for h in (0.4, 0.2)])), float(richardson([3.0]))]
    [1.0, 3.0]
    """
    table = list(values)
    if not table:
        raise InputError("there are no values to extrapolate")
    for power in 4.0 ** np.arange(1, len(table)):
        table = [(power * fine - coarse) / (power - 1.0) for coarse, fine in zip(table, table[1:])]
    return table[0]


def central_difference(function: Callable[[float], np.ndarray], step: float = 1e-2, levels: int = 4) -> np.ndarray:
    """Differentiate a function of one number at zero by central differences, extrapolated to a step of zero.

    Parameters
    ----------
    function : callable
        ``function(h)``, a number or an array.
    step : float
        Largest step.
    levels : int
        Number of steps. With two of them this is the five-point rule, of fourth order.

    Returns
    -------
    float or ndarray
        The derivative.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.testing import central_difference
    >>> round(float(central_difference(lambda h: np.exp(2.0 * h), step=0.1)), 10)
    2.0
    """
    return richardson(central_differences(function, step, levels))


def complex_step(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Differentiate a real analytic function along a direction by a complex step, exact to round-off.

    Parameters
    ----------
    function : callable
        Takes a complex array of the shape of ``x``. It must keep its imaginary part: no ``abs``, no ``float``.
    x, direction : ndarray
        The point and the direction, of the same shape.

    Returns
    -------
    ndarray
        The derivative, in the shape of the function's value.

    Raises
    ------
    InputError
        If ``x`` is empty, or the function returns nothing or numbers that are not complex.

    Notes
    -----
    W. Squire and G. Trapp, "Using complex variables to estimate derivatives of real functions", SIAM Review 40, 1998.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.testing import complex_step
    >>> complex_step(lambda x: x**2, np.array([1.0, 3.0]), np.array([1.0, 1.0]))
    array([2., 6.])
    """
    step = 1e-30  # nothing is subtracted, so there is no cancellation, and the error of order step^2 may vanish
    x, direction = np.asarray(x, dtype=float), np.asarray(direction, dtype=float)
    value = np.asarray(function(x + 1j * step * direction))
    if x.size == 0 or value.size == 0:
        raise InputError("there is nothing to differentiate: the argument or the value is empty")
    if not np.iscomplexobj(value):
        raise InputError(f"the function turns complex numbers into {value.dtype}: it drops the derivative")
    return value.imag / step


def dot_test(
    forward: Callable[[np.ndarray], np.ndarray],
    reverse: Callable[[np.ndarray], np.ndarray],
    shape_in: int | tuple[int, ...],
    shape_out: int | tuple[int, ...],
    n_directions: int = 3,
    seed: int = 0,
) -> float:
    """Compare products with a matrix and with its transpose: ``y @ (J x)`` equals ``(J^T y) @ x``.

    Parameters
    ----------
    forward, reverse : callable
        Products ``J x`` and ``J^T y``, of arguments of shapes ``shape_in`` and ``shape_out``.
    shape_in, shape_out : int or tuple of int
        Shapes of ``x`` and ``y``.
    n_directions : int
        Random pairs ``x``, ``y``.
    seed : int
        Seed of the random pairs.

    Returns
    -------
    float
        Largest difference of the two, relative to ``|y| |J x| + |J^T y| |x|``. About 1e-15 is round-off.

    Raises
    ------
    InputError
        If a vector is empty, a product has the wrong shape, or all products are zero.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.testing import dot_test
    >>> J = np.arange(6.0).reshape(2, 3)
    >>> bool(dot_test(lambda x: J @ x, lambda y: J.T @ y, 3, 2) < 1e-15)
    True
    >>> bool(dot_test(lambda x: J @ x, lambda y: J[::-1].T @ y, 3, 2) < 0.01)
    False
    """
    random, errors = np.random.default_rng(seed), []
    for _ in range(n_directions):
        x, y = random.uniform(-1.0, 1.0, shape_in), random.uniform(-1.0, 1.0, shape_out)
        if x.size == 0 or y.size == 0:
            raise InputError("there is nothing to compare: a vector is empty")
        ahead, back = np.asarray(forward(x)), np.asarray(reverse(y))
        for name, product, like in (("forward", ahead, y), ("reverse", back, x)):
            if product.shape != like.shape:
                raise InputError(f"the {name} product has the shape {product.shape}, not {like.shape}")
        size = np.linalg.norm(y) * np.linalg.norm(ahead) + np.linalg.norm(back) * np.linalg.norm(x)
        if size > 0.0:
            errors.append(abs(np.vdot(y, ahead) - np.vdot(back, x)) / size)
    if not errors:
        raise InputError("there is nothing to compare: all products are zero")
    return float(max(errors))


def taylor_rate(
    function: Callable[[np.ndarray], np.ndarray],
    x: np.ndarray,
    direction: np.ndarray,
    derivative: np.ndarray,
    step: float = 1e-2,
    levels: int = 4,
) -> float:
    """Find the order at which the remainder ``|f(x + h d) - f(x) - h f'|`` vanishes: 2 if the derivative is right.

    Parameters
    ----------
    function : callable
        The function.
    x, direction : ndarray
        The point and the direction.
    derivative : ndarray
        The derivative along the direction, of the shape of the function's values.
    step : float
        Largest step ``h``, which is halved ``levels - 1`` times.
    levels : int
        Number of steps.

    Returns
    -------
    float
        Mean order over the steps: 2, or more if second derivatives vanish, infinite for a function that is linear to
        round-off; 1 for a wrong derivative.

    Raises
    ------
    InputError
        If the function returns nothing, or neither changes along the direction nor has a derivative.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.testing import taylor_rate
    >>> x, d = np.array([0.3, 0.8]), np.array([1.0, -2.0])
    >>> [round(taylor_rate(np.sin, x, d, slope * d), 1) for slope in (np.cos(x), 0.9 * np.cos(x))]
    [2.0, 1.0]
    """
    steps = step / 2.0 ** np.arange(levels)
    start, derivative = np.asarray(function(x)), np.asarray(derivative)
    changes = [np.asarray(function(x + h * direction)) - start for h in steps]
    if start.size == 0 or (np.linalg.norm(changes[0]) == 0.0 and np.linalg.norm(derivative) == 0.0):
        raise InputError("there is nothing to compare: the function is empty or does not change along the direction")
    remainders = np.array([np.linalg.norm(change - h * derivative) for change, h in zip(changes, steps)])
    round_off = 100.0 * np.finfo(float).eps * max(np.linalg.norm(start), np.linalg.norm(changes[0]))
    if remainders[0] <= round_off:
        return np.inf
    is_seen = remainders > round_off  # below it the remainder is round-off
    return float(np.polyfit(np.log(steps[is_seen]), np.log(remainders[is_seen]), 1)[0]) if is_seen.sum() > 1 else np.inf


def central_differences(function: Callable[[float], np.ndarray], step: float, levels: int) -> list:
    """Return the central differences at halved steps, which `richardson` extrapolates."""
    return [(function(h) - function(-h)) / (2.0 * h) for h in step / 2.0 ** np.arange(levels)]
