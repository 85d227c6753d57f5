"""The generator of derivatives is right, refuses what it cannot differentiate, and its files are what it writes."""

import ast
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tools"))

from differentiate import FILES, NotStraight, derivatives, module  # noqa: E402

SCALE = 0.7
"""Constant of the kernels below."""

POINT = tuple(np.random.default_rng(11).uniform(0.5, 1.5, 4))


def helper(a, b):
    total = a[0] * b[0] + a[1] * b[1]
    return total * total


class Kernel:
    """A kernel compiled by numba is its Python function here."""

    def __init__(self, function):
        self.py_func = function

    def __call__(self, *arguments):
        return self.py_func(*arguments)


dot2 = Kernel(helper)


def scaled(factor, a):
    return factor * a[0], factor * a[1]


times = Kernel(scaled)


def bent(x, at):
    return x * x if x.real > at else at * (2.0 * x - at)


def bent_slope(x, at):
    return 2.0 * x if x.real > at else 2.0 * at


def with_a_constant(x):
    return SCALE * x


hidden = Kernel(with_a_constant)


def every_operation(x, k, y):
    a, (b, c), _ = x[0], (x[1], x[2]), x[3]
    low = -a / (SCALE + b * b) - c**3 + k / c
    root = np.sqrt(low * low + 1.0) * np.exp(-y[0][1])
    turned = np.sin(y[1][0]) * np.cos(y[0][0]) + np.log(1.0 + b) ** k
    u = times(root, (a, turned))
    nested = dot2(times(turned, u), (b, y[1][1] - 2.0)) / (1.0 / (1.0 + low * low))
    first = bent(nested * 0.1, k)
    lone = -(b * c**2)
    return first, (u, low, lone), x[3], k


SHAPES = {"x": 4, "y": (2, 2)}


def flat(tree):
    """Numbers of a tree of tuples, in order."""
    return np.concatenate([flat(part) for part in tree]) if isinstance(tree, tuple) else np.atleast_1d(tree)


def like(shape, values):
    """Tree of tuples of a shape from an iterator of numbers."""
    parts = shape if isinstance(shape, tuple) else (0,) * shape
    return tuple(like(part, values) for part in parts) if shape else next(values)


def compiled(function, shapes):
    """Generated derivatives of a function of this file."""
    source, _ = derivatives(function, shapes)
    names = dict(globals()) | {"njit": lambda **_: lambda kernel: kernel}
    exec(source, names)
    return names[f"{function.__name__}_jvp"], names[f"{function.__name__}_vjp"]


@pytest.mark.parametrize("seed", range(5))
def test_the_change_is_the_complex_step_and_the_derivative_backward_its_transpose(seed):
    rng = np.random.default_rng(seed)
    at, step = rng.uniform(0.3, 1.7, 8), rng.standard_normal(8)
    k = rng.uniform(0.2, 2.5)
    jvp, vjp = compiled(every_operation, SHAPES)

    def at_point(values):
        numbers = iter(values)
        return like(4, numbers), like((2, 2), numbers)

    (x, y), (d_x, d_y) = at_point(at), at_point(step)
    z, w = at_point(at + 1e-30j * step)
    expected = flat(every_operation(z, k, w)).imag / 1e-30
    change = flat(jvp(x, k, y, d_x, d_y))
    np.testing.assert_allclose(change, expected, rtol=1e-13, atol=1e-13 * np.abs(expected).max())
    bar = rng.standard_normal(len(change))
    numbers = iter(bar)
    back = flat(vjp(x, k, y, (next(numbers), ((next(numbers), next(numbers)), next(numbers), next(numbers)), *numbers)))
    assert back @ step == pytest.approx(bar @ change, rel=1e-12, abs=1e-12)


def random_kernel(rng):
    """Source of a straight-line function of three numbers: ten random operations of earlier results."""
    forms = (
        "{0} + {1}",
        "{0} - {1}",
        "{0} * {1}",
        "{0} / (2.0 + {1} ** 2)",
        "np.sqrt(1.5 + {0} * {0}) + {1}",
        "-{0} * np.sin({1})",
    )
    names, lines = ["a", "b", "c"], ["def kernel(x):", "    a, b, c = x"]
    for n in range(10):
        one, other = rng.choice(names, 2)
        lines.append(f"    t{n} = {forms[rng.integers(len(forms))].format(one, other)}")
        names.append(f"t{n}")
    return "\n".join([*lines, f"    return {', '.join(names[-3:])}"])


@pytest.mark.parametrize("seed", range(8))
def test_random_straight_line_code_is_differentiated(seed, tmp_path, monkeypatch):
    rng = np.random.default_rng(seed)
    name = f"random_kernel_{seed}"
    (tmp_path / f"{name}.py").write_text(f"import numpy as np\n\n\n{random_kernel(rng)}\n")
    monkeypatch.syspath_prepend(tmp_path)
    kernel = __import__(name).kernel
    jvp, vjp = compiled(kernel, {"x": 3})
    x, d_x, bar = rng.standard_normal((3, 3))
    expected = np.array(kernel(tuple(x + 1e-30j * d_x))).imag / 1e-30
    change = np.array(jvp(tuple(x), tuple(d_x)))
    scale = np.abs(expected).max()
    np.testing.assert_allclose(change, expected, rtol=1e-13, atol=1e-13 * scale)
    assert np.array(vjp(tuple(x), tuple(bar))) @ d_x == pytest.approx(bar @ change, rel=1e-12, abs=1e-12 * scale)


def with_a_branch(x):
    if x > 0.0:
        return x
    return -x


def with_a_choice(x):
    return x if x > 0.0 else -x


def with_a_loop(x):
    total = 0.0
    for n in range(3):
        total += n * x
    return total


def in_place(x):
    total = 2.0 * x
    total += x
    return total


def assigned_twice(x):
    total = 2.0 * x
    total = total * x
    return total


def into_an_array(x, out):
    out[0] = x
    return x


def with_a_kink(x):
    return abs(x) + np.maximum(x, 0.0)


def of_two_things(x):
    SCALE = x * x
    return hidden(SCALE)


def of_what_is_unknown(x):
    return x * POINT


def of_a_power(x):
    return 2.0**x


def of_a_name_of_a_derivative(x):
    d_x = x * x
    return d_x


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (with_a_branch, "if x > 0.0:: this is no straight-line code"),
        (with_a_choice, "x if x > 0.0 else -x: this is no straight-line code"),
        (with_a_loop, "for n in range"),
        (in_place, r"total \+= x"),
        (assigned_twice, "names are assigned once"),
        (into_an_array, "names are assigned once, and no arrays"),
        (with_a_kink, "abs"),
        (of_two_things, "SCALE stands for two things"),
        (of_what_is_unknown, "POINT is no number"),
        (of_a_power, "has no derivative here"),
        (of_a_name_of_a_derivative, "d_x are names of derivatives"),
    ],
)
def test_what_has_no_derivative_is_refused_by_name(function, message):
    with pytest.raises(NotStraight, match=message):
        derivatives(function, {"x": 0})


@pytest.mark.parametrize("file", FILES)
def test_the_files_are_what_the_generator_writes(file):
    written, now = ast.parse((ROOT / file).read_text()), ast.parse(module(file))
    for tree in (written, now):
        imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
        pairs = sorted((node.level, node.module, alias.name) for node in imports for alias in node.names)
        tree.body = [*(node for node in tree.body if node not in imports), ast.Constant(str(pairs))]
    assert ast.unparse(written) == ast.unparse(now), "run python tools/differentiate.py"
