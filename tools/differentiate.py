"""Write the derivatives of straight-line kernels from their source, forward (``_jvp``) and backward (``_vjp``).

``python tools/differentiate.py`` writes the files of `FILES`, which are part of the package: they are read, and numba
keeps them compiled, as any other kernel. A test fails where one is not what its kernel gives.

It is ours because no library gives what is needed, Python that numba inlines into the loop over the faces and caches:
Tapenade writes Fortran and C, Enzyme and JAX compile by themselves, Tangent stacks whole arrays, SymPy forgets names.

A kernel is straight-line code on numbers and on tuples of a known size: assignments, each name once, ``+ - * / **``,
the functions of `SLOPES`, calls of other such kernels, which are written out, and one result. A function ``f`` of one
number, then of constants, may have branches where its derivative is a function ``f_slope`` beside it. Anything else
is refused: a branch that jumps has no derivative, and a loop over data belongs around a kernel.

Every operation is linear in the changes of its operands, with factors that are the same forward and backward, see
`_factors`. Forward, each line is followed by its change; backward, each number gets one line: what all its uses give.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import itertools
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[1]

BOTH, FORWARD = ("_jvp", "_vjp"), ("_jvp",)
"""Which of the two are wanted."""

FILES: dict[str, tuple[tuple[str, str, dict, tuple[str, ...]], ...]] = {
    "bspline_mdao/core/movement/spring_pulls_derivatives.py": (  # symmetric in the corners: their own transposes
        ("bspline_mdao.core.movement.spring_pulls", "lineal_pull", {"a": 3, "b": 3}, FORWARD),
        ("bspline_mdao.core.movement.spring_pulls", "angular_pull", {"vertex": 3, "a": 3, "b": 3}, FORWARD),
        ("bspline_mdao.core.movement.spring_pulls", "solid_pull", {"vertex": 3, "a": 3, "b": 3, "c": 3}, FORWARD),
    ),
    "bspline_mdao/flow/euler/flux_derivatives.py": (
        ("bspline_mdao.flow.euler.flux", "face_flux", {"w": 5, "j": 5, "s": 3, "shock": 0}, BOTH),
    ),
    "bspline_mdao/flow/euler/sensor_derivatives.py": (
        (
            "bspline_mdao.flow.euler.sensor",
            "stencil_sensor",
            {"first": 5, "left": 0, "right": 0, "last": 5},
            BOTH,
        ),
    ),
    "bspline_mdao/flow/euler/vortex_state_derivatives.py": (
        (
            "bspline_mdao.flow.euler.vortex_state",
            "vortex_state",
            {"stream": 5, "lift": 3, "circulation": 0},
            FORWARD,
        ),
    ),
    "bspline_mdao/flow/euler/face_centre_derivatives.py": (
        ("bspline_mdao.flow.euler.face_centre", "face_centre", {"a": 3, "b": 3, "c": 3, "d": 3}, BOTH),
    ),
    "bspline_mdao/flow/euler/irregular_weights_derivatives.py": (
        ("bspline_mdao.flow.euler.irregular_weights", "free_changes", {"face": (3, 3, 3, 3, 3, (3, 3, 3))}, BOTH),
    ),
    "bspline_mdao/flow/euler/irregular_bounds_derivatives.py": (
        ("bspline_mdao.flow.euler.irregular_weights", "bounded_changes", {"free": 4}, BOTH),
    ),
}
"""Files that are written: modules and names of the kernels, and shapes of the arguments by which they are
differentiated, the others being constants: the size of a tuple, 0 for a number, or shapes of its parts. Last which of
the two derivatives are wanted."""

SLOPES = {"sqrt": "0.5 / y", "exp": "y", "log": "1.0 / x", "sin": "np.cos(x)", "cos": "-np.sin(x)"}
"""Derivatives of functions of NumPy, of their argument x and value y."""

OPTIONS = 'cache=True, error_model="numpy", forceinline=True, fastmath={"arcp", "contract", "nnan", "nsz"}'
"""Of numba, for derivatives: inlined, and allowed to take 0 x for 0, so that what a constant direction leaves is all
that is compiled."""


class NotStraight(Exception):
    """A kernel has what cannot be differentiated."""


@dataclass
class Kernel:
    """Straight-line code on numbers: what is divided by, and values of functions, have lines of their own.

    ``lines`` are pairs of a name and what it is; ``active`` are the names that change; ``imports`` are the modules that
    names are from.
    """

    lines: list[tuple[ast.Name, ast.expr]] = field(default_factory=list)
    active: list[ast.Name] = field(default_factory=list)
    used: set[str] = field(default_factory=set)
    imports: dict[str, str] = field(default_factory=dict)
    unnamed: list[ast.Name] = field(default_factory=list)  # may take the name that the source gives them

    def follow(self, function: Callable, arguments: tuple):
        """Write out the body of a function of trees of expressions, and return its result."""
        body = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        names = [one.arg for one in body.args.args]
        known = dict(zip(names, arguments, strict=True))
        for line in body.body:
            match line:
                case ast.Expr(ast.Constant(str())):
                    continue
                case ast.Assign([target], value):
                    self._assign(target, self._value(value, known, function), known, line)
                case ast.Return(value) if value is not None:
                    return self._value(value, known, function)
                case _:
                    raise _refused(line, function)
        raise NotStraight(f"{function.__name__}: returns nothing")

    def name(self, value, hint: str):
        """Names for all numbers of a tree, and lines for those that are none yet."""
        if isinstance(value, tuple):
            return tuple(self.name(part, f"{hint}{k}") for k, part in enumerate(value))
        if not isinstance(value, ast.BinOp | ast.UnaryOp | ast.Call):
            return value
        name = self.new(hint)
        if self.is_active(value):
            self.active.append(name)
        self.lines.append((name, value))
        return name

    def new(self, hint: str) -> ast.Name:
        """A name that is not used yet."""
        others = (f"{hint}_{k}" for k in itertools.count(2))
        found = next(name for name in itertools.chain([hint], others) if name not in self.used)
        self.used.add(found)
        return ast.Name(found)

    def is_active(self, value: ast.expr) -> bool:
        """Whether an expression changes."""
        return any(node is name for node in ast.walk(value) for name in self.active)

    def _assign(self, target: ast.expr, value, known: dict, line: ast.stmt) -> None:
        if isinstance(target, ast.Tuple):
            if not isinstance(value, tuple) or len(value) != len(target.elts):
                raise NotStraight(f"{ast.unparse(line)}: as many names as numbers are needed")
            for one, part in zip(target.elts, value):
                self._assign(one, part, known, line)
            return
        if not isinstance(target, ast.Name) or target.id in known:
            raise NotStraight(f"{ast.unparse(line)}: names are assigned once, and no arrays")
        known[target.id] = self.name(value, target.id)
        self._rename(known[target.id], target.id)

    def _rename(self, value, hint: str) -> None:
        """Give what has no name of its own yet the name of the source."""
        for k, part in enumerate(value if isinstance(value, tuple) else ()):
            self._rename(part, f"{hint}{k}")
        if any(value is name for name in self.unnamed) and hint not in self.used:
            self.used.discard(value.id)
            self.used.add(hint)
            value.id = hint
            self.unnamed = [name for name in self.unnamed if name is not value]

    def _part(self, value: ast.expr) -> ast.expr:
        """A line of its own, if it changes and is more than a name, for an operand that is needed more than once."""
        if not self.is_active(value) or isinstance(value, ast.Name):
            return value
        name = self.name(value, "part")
        self.unnamed.append(name)
        return name

    def _value(self, node: ast.expr, known: dict, scope: Callable):
        """Tree of expressions of names that are known here, helpers written out."""
        match node:
            case ast.Constant(int() | float()):
                return node
            case ast.Name(name):
                return known[name] if name in known else self._constant(name, scope)
            case ast.Tuple(parts):
                return tuple(self._value(part, known, scope) for part in parts)
            case ast.Subscript(of, ast.Constant(int() as place)):
                value = self._value(of, known, scope)
                return value[place] if isinstance(value, tuple) else ast.Subscript(value, ast.Constant(place))
            case ast.UnaryOp(ast.USub(), of):
                return ast.UnaryOp(ast.USub(), self._value(of, known, scope))
            case ast.BinOp(left, operation, right):
                return self._operation(operation, self._value(left, known, scope), self._value(right, known, scope))
            case ast.Call(function, arguments, []):
                return self._call(function, [self._value(one, known, scope) for one in arguments], scope)
        raise _refused(node, scope)

    def _operation(self, operation: ast.operator, left, right) -> ast.expr:
        if isinstance(left, tuple) or isinstance(right, tuple):
            raise NotStraight("arithmetic is of numbers, not of tuples")
        match operation:
            case ast.Add() | ast.Sub() | ast.Mult():
                return ast.BinOp(left, operation, right)
            case ast.Div():
                of_active = self.is_active(right)
                value = ast.BinOp(left, operation, self._part(right))
                return self._part(value) if of_active else value
            case ast.Pow() if not self.is_active(right):
                value, is_number = ast.BinOp(self._part(left), operation, right), isinstance(right, ast.Constant)
                return value if is_number else self._part(value)
        raise NotStraight(f"{ast.unparse(ast.BinOp(left, operation, right))}: has no derivative here")

    def _call(self, function: ast.expr, arguments: list, scope: Callable):
        match function:
            case ast.Attribute(ast.Name("np"), name) if name in SLOPES:
                return self._part(ast.Call(function, [self._part(arguments[0])], []))
            case ast.Name(name) if name in scope.__globals__:
                if f"{name}_slope" in scope.__globals__:
                    self._import(name, scope)
                    self._import(f"{name}_slope", scope)
                    return self._part(ast.Call(function, [self._part(arguments[0]), *arguments[1:]], []))
                called = getattr(scope.__globals__[name], "py_func", None)
                if called is not None:
                    names = list(inspect.signature(called).parameters)
                    value = self.follow(called, tuple(map(self.name, arguments, names)))
                    return value if isinstance(value, tuple) else self._part(value)
        raise _refused(function, scope)

    def _constant(self, name: str, scope: Callable) -> ast.expr:
        """A number of the module of a function, by its name."""
        if not isinstance(scope.__globals__.get(name), int | float):
            raise NotStraight(f"{scope.__name__}: {name} is no number")
        self._import(name, scope)
        return ast.Name(name)

    def _import(self, name: str, scope: Callable) -> None:
        """Take a name from the module of a function, or from where that has it."""
        home = _home(inspect.getmodule(scope), name)
        if self.imports.get(name, home) != home or (name in self.used and name not in self.imports):
            raise NotStraight(f"{scope.__name__}: {name} stands for two things")
        self.imports[name] = home
        self.used.add(name)


def _refused(node: ast.AST, scope: Callable) -> NotStraight:
    return NotStraight(f"{scope.__name__}: {ast.unparse(node).splitlines()[0]}: this is no straight-line code")


def _factors(line: ast.expr, value: ast.Name) -> tuple[list[tuple[ast.expr, ast.expr | None, bool]], ast.expr | None]:
    """Operands of an operation with the factors of their changes, None for 1, and whether they are subtracted.

    Also what the sum of these is divided by, if anything. It is the derivative of every operation, and that is all.
    """
    match line:
        case ast.BinOp(left, ast.Add() | ast.Sub() as sign, right):
            return [(left, None, False), (right, None, isinstance(sign, ast.Sub))], None
        case ast.UnaryOp(ast.USub(), of):
            return [(of, None, True)], None
        case ast.BinOp(ast.Name() as left, ast.Mult(), ast.Name() as right) if left is right:
            return [(left, _times(ast.Constant(2.0), left), False)], None
        case ast.BinOp(left, ast.Mult(), right):
            return [(left, right, False), (right, left, False)], None
        case ast.BinOp(left, ast.Div(), right):
            return [(left, None, False), (right, value, True)], right
        case ast.BinOp(base, ast.Pow(), ast.Constant(power)):
            lower = base if power == 2 else ast.BinOp(base, ast.Pow(), ast.Constant(power - 1))
            return [(base, _times(ast.Constant(float(power)), lower), False)], None
        case ast.BinOp(base, ast.Pow(), power):
            return [(base, _times(power, value), False)], base
        case ast.Call(ast.Attribute(_, name), [of], _):
            slope = _replaced(ast.parse(SLOPES[name], mode="eval").body, {"x": of, "y": value})
            if isinstance(slope, ast.BinOp) and isinstance(slope.op, ast.Div):
                return [(of, None if slope.left.value == 1.0 else slope.left, False)], slope.right
            return [(of, slope, False)], None
        case ast.Call(ast.Name(name), [of, *constants], _):
            return [(of, ast.Call(ast.Name(f"{name}_slope"), [of, *constants], []), False)], None
    return [], None


def _replaced(formula: ast.expr, names: dict[str, ast.expr]) -> ast.expr:
    """A formula with other expressions for its names."""

    class Replace(ast.NodeTransformer):
        def visit_Name(self, node):
            return names.get(node.id, node)

    return Replace().visit(formula)


def _times(left: ast.expr | None, right: ast.expr) -> ast.expr:
    """A product from left to right, which is quicker to read."""
    if left is None:
        return right
    if isinstance(right, ast.BinOp) and isinstance(right.op, ast.Mult | ast.Div):
        return ast.BinOp(_times(left, right.left), right.op, right.right)
    if isinstance(right, ast.UnaryOp):
        return ast.UnaryOp(ast.USub(), _times(left, right.operand))
    return ast.BinOp(left, ast.Mult(), right)


def _terms(term: ast.expr, is_less: bool) -> Iterator[tuple[ast.expr, bool]]:
    """Terms of a sum, and whether they are subtracted."""
    match term:
        case ast.BinOp(left, ast.Add() | ast.Sub() as sign, right):
            yield from _terms(left, is_less)
            yield from _terms(right, is_less != isinstance(sign, ast.Sub))
        case ast.UnaryOp(ast.USub(), of):
            yield from _terms(of, not is_less)
        case _:
            yield term, is_less


def _minus(term: ast.expr) -> ast.expr:
    """A term with the other sign."""
    is_product = isinstance(term, ast.BinOp) and isinstance(term.op, ast.Mult)
    if is_product and "/" not in ast.unparse(term):  # a quotient may stand elsewhere, as it is
        return ast.BinOp(_minus(term.left), term.op, term.right)
    return ast.UnaryOp(ast.USub(), term)


def _sum(terms: list[tuple[ast.expr, bool]]) -> ast.expr:
    """A sum of terms, some of them subtracted, those that are not first."""
    plain = [one for term in terms for one in _terms(*term)]
    first, *rest = sorted(plain, key=lambda term: term[1])
    total = _minus(first[0]) if first[1] else first[0]
    for term, is_less in rest:
        total = ast.BinOp(total, ast.Sub() if is_less else ast.Add(), term)
    return total


def _change(kernel: Kernel, line: ast.expr, value: ast.Name) -> ast.expr | None:
    """Change of a line; None if it has none."""
    if isinstance(line, ast.Name):
        return ast.Name(f"d_{line.id}") if kernel.is_active(line) else None
    operands, divisor = _factors(line, value)
    changes = [(_change(kernel, of, value), factor, is_less) for of, factor, is_less in operands]
    terms = [(_times(factor, change), is_less) for change, factor, is_less in changes if change is not None]
    if not terms:
        return None
    return _sum(terms) if divisor is None else ast.BinOp(_sum(terms), ast.Div(), divisor)


def _uses(
    kernel: Kernel, line: ast.expr, value: ast.Name, bar: ast.expr, is_less: bool
) -> Iterator[tuple[str, ast.expr, bool]]:
    """What the names of a line get of the derivative with respect to its value."""
    if not kernel.is_active(line):
        return
    if isinstance(line, ast.Name):
        yield line.id, bar, is_less
        return
    operands, divisor = _factors(line, value)
    bar = bar if divisor is None else ast.BinOp(bar, ast.Div(), divisor)
    for of, factor, is_other in operands:
        yield from _uses(kernel, of, value, bar if factor is None else _times(bar, factor), is_less != is_other)


def _leaves(tree) -> Iterator[ast.expr]:
    for part in tree if isinstance(tree, tuple) else ():
        yield from _leaves(part)
    if not isinstance(tree, tuple):
        yield tree


def _text(tree, of: Callable[[ast.expr], str]) -> str:
    """Text of a tree of tuples."""
    if not isinstance(tree, tuple):
        return of(tree)
    return ast.unparse(ast.parse(f"({', '.join(_text(part, of) for part in tree)},)"))


def _tree(kernel: Kernel, name: str, shape) -> ast.Name | tuple:
    """Names of the numbers of an argument."""
    parts = shape if isinstance(shape, tuple) else (0,) * shape
    return tuple(_tree(kernel, f"{name}{k}", part) for k, part in enumerate(parts)) or kernel.new(name)


def _living(lines: list[tuple[str, str]], result: str) -> str:
    """Body of a function: the lines, names and their values, that the result needs, and it."""

    def names(text: str) -> set[str]:
        return {node.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)}

    needed, kept = names(result), [f"    return {result}"]
    for target, value in reversed(lines):
        if names(target) & needed:
            needed |= names(value)
            kept.append(f"    {target} = {value}")
    return "\n".join(reversed(kept))


def derivatives(function: Callable, shapes: dict, wanted: tuple[str, ...] = BOTH) -> tuple[str, dict[str, str]]:
    """Source of the derivatives of a function, and the modules of what it imports, by the name."""
    name, kernel = function.__name__, Kernel()
    arguments = list(inspect.signature(function).parameters)
    kernel.used |= set(arguments) - {one for one, shape in shapes.items() if shape == 0}
    trees = {one: _tree(kernel, one, shape) for one, shape in shapes.items()}
    kernel.active = list(_leaves(tuple(trees.values())))
    kernel.unnamed = [leaf for tree in trees.values() if isinstance(tree, tuple) for leaf in _leaves(tree)]
    result = kernel.name(kernel.follow(function, tuple(trees.get(one, ast.Name(one)) for one in arguments)), "out")
    derived = {f"d_{one.id}" for one in kernel.active} | {f"{one.id}_bar" for one in kernel.active}
    if clash := sorted(derived & kernel.used):
        raise NotStraight(f"{name}: {', '.join(clash)} are names of derivatives")
    by = ", ".join(f"``{one}``" for one in shapes)
    sources = {
        "_jvp": f'''
@njit({OPTIONS})
def {name}_jvp({", ".join([*arguments, *(f"d_{one}" for one in shapes)])}):
    """Change of `{name}` with {by}."""
{_forward(kernel, trees, result)}
''',
        "_vjp": f'''
@njit({OPTIONS})
def {name}_vjp({", ".join([*arguments, "bar"])}):
    """Transpose of `{name}_jvp`: derivatives with respect to {by}."""
{_backward(kernel, trees, result)}
''',
    }
    return "\n\n".join(sources[one] for one in wanted), kernel.imports


def _forward(kernel: Kernel, trees: dict, result) -> str:
    """Lines that follow a change."""
    lines = _unpacked(trees, "{}") + _unpacked({f"d_{one}": tree for one, tree in trees.items()}, "d_{}")
    for target, line in kernel.lines:
        lines.append((target.id, ast.unparse(line)))
        if kernel.is_active(target):
            lines.append((f"d_{target.id}", ast.unparse(_change(kernel, line, target))))
    return _living(lines, _text(result, lambda leaf: f"d_{leaf.id}" if kernel.is_active(leaf) else "0.0"))


def _backward(kernel: Kernel, trees: dict, result) -> str:
    """Lines that follow a derivative from the result to the arguments."""
    given: dict[str, list[tuple[ast.expr, bool]]] = {one.id: [] for one in kernel.active}
    bars = [kernel.new(f"bar{k}") for k, _ in enumerate(_leaves(result))]
    for leaf, bar in zip(_leaves(result), bars):
        if kernel.is_active(leaf):
            given[leaf.id].append((bar, False))
    of_result = iter(bars)
    lines = [*_unpacked(trees, "{}"), (_text(result, lambda leaf: next(of_result).id), "bar")]
    lines += [(target.id, ast.unparse(line)) for target, line in kernel.lines]
    arguments = list(_leaves(tuple(trees.values())))
    for target, line in [*reversed(kernel.lines), *((leaf, None) for leaf in arguments)]:
        if kernel.is_active(target):
            bar = ast.Name(f"{target.id}_bar")
            lines.append((bar.id, ast.unparse(_sum(given[target.id])) if given[target.id] else "0.0"))
            for name, term, is_less in _uses(kernel, line, target, bar, False) if line else ():
                given[name].append((term, is_less))
    found = tuple(trees.values())
    return _living(lines, _text(found if len(found) > 1 else found[0], lambda leaf: f"{leaf.id}_bar"))


def _unpacked(trees: dict, form: str) -> list[tuple[str, str]]:
    """Lines that take tuples to pieces."""
    whole = {one: tree for one, tree in trees.items() if isinstance(tree, tuple)}
    return [(_text(tree, lambda leaf: form.format(leaf.id)), one) for one, tree in whole.items()]


def module(name: str) -> str:
    """Source of a file of `FILES`."""
    sources, imports = [], {}
    for of_module, kernel, shapes, wanted in FILES[name]:
        function = getattr(importlib.import_module(of_module), kernel).py_func
        source, needed = derivatives(function, shapes, wanted)
        sources.append(source)
        imports |= needed
    body = "\n\n".join(sources)
    kernels = " and ".join(f"`{kernel}`" for _, kernel, _, _ in FILES[name])
    lines = sorted(f"from {_relative(home, name)} import {constant}" for constant, home in imports.items())
    numpy = "import numpy as np\n" if "np." in body else ""
    return f'''"""Derivatives of {kernels}.

Written by ``tools/differentiate.py``: change the kernel, then run that.
"""

from __future__ import annotations

{numpy}from numba import njit

{chr(10).join(lines)}

{body}'''


def _home(module: ModuleType, name: str) -> str:
    """Module that a module has a name from."""
    for node in ast.parse(inspect.getsource(module)).body:
        if isinstance(node, ast.ImportFrom) and name in [alias.name for alias in node.names]:
            return importlib.util.resolve_name("." * node.level + (node.module or ""), module.__package__)
    return module.__name__


def _relative(home: str, file: str) -> str:
    """A module as a file imports it."""
    here, there = Path(file).with_suffix("").parts[:-1], home.split(".")
    common = sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], zip(here, there)))
    return "." * (len(here) - common + 1) + ".".join(there[common:])


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    for name in FILES:
        (ROOT / name).write_text(module(name))
    subprocess.run(["ruff", "check", "--quiet", "--fix", "--select", "I", *FILES], cwd=ROOT, check=True)
    subprocess.run(["ruff", "format", "--quiet", *FILES], cwd=ROOT, check=True)
