"""Grid evaluation, Eq. (3), entirely in JAX: ``A b + r`` on the device of the control points, for example a GPU.

A node is the sum over the p^3 control points of its span, whose numbers follow from the first one and two steps, as in
`bspline_mdao.core.evaluation.nodes_by_span`; 3 p function values and three integers are stored for each node. The map
and its transpose are one primitive: the derivative of a linear map needs no computed values, whereas a loop over the
p^3 control points, differentiated by JAX, would store all its products.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from ...grids.topology.node_numbering import NodeNumbering
from ..model.fitted_model import FittedModel
from ..splines.basis import basis
from .jax_functions import need_jax

__all__ = ["device_grid"]


def device_grid(model: FittedModel) -> Callable:
    """Make the grid a pure JAX function, evaluated on the device of the control points.

    It is ``A b + r`` in the precision of the control points, single or double. It works under all JAX transformations,
    has second derivatives (zero), and equals `grid` to round-off, about 1e-15 or 1e-7 of the size of the grid. On a CPU
    it takes many times as long as `grid`.

    Parameters
    ----------
    model : FittedModel
        The fitted grid, with ``wall_layer=False``, so that the map is linear.

    Returns
    -------
    callable
        Function of control points (m), shape (n_control_points, 3), that returns the grid nodes (m), shape (n_nodes,
        3).

    Raises
    ------
    InputError
        If JAX is not installed, or the map is not linear: nodes that follow walls and rotating residuals are supported
        only on the CPU.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.jax import device_grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)), wall_layer=False)
    >>> nodes = device_grid(model)(np.float32(model.control_points))  # doctest: +SKIP
    >>> nodes.shape, nodes.dtype  # doctest: +SKIP
    ((750, 3), dtype('float32'))
    """
    jax = need_jax()
    if not isinstance(model, FittedModel):
        raise InputError(f"device_grid: the model is of type {type(model).__name__}; make it with fit_grid(grid)")
    if not model.is_linear:
        raise InputError(
            f"device_grid: nodes of {model.source} follow walls, or periodic sides, which is on the CPU alone; fit "
            f"with wall_layer=False, or take grid(model)"
        )
    (groups, copies), shape, residual = _groups(model), model.control_points.shape, model.residual
    rows = np.empty(model.n_nodes, dtype=np.int32)  # the node of every row, or the one it copies
    evaluated = np.concatenate([group.rows for group in groups])
    rows[evaluated] = np.arange(len(evaluated))
    rows[copies[:, 0]] = rows[copies[:, 1]]

    @cache
    def constants(dtype: Any) -> tuple:
        """Data of the map, on the device, in the precision of the control points."""
        with jax.ensure_compile_time_eval():
            parts = [
                (*map(jax.numpy.asarray, group.integers), *(jax.numpy.asarray(f, dtype) for f in group.functions))
                for group in groups
            ]
            added = None if residual is None else jax.numpy.asarray(residual, dtype)
            return parts, jax.numpy.asarray(rows), added

    def nodes(control_points: Any) -> Any:
        points = jax.numpy.asarray(control_points)
        if points.shape != shape:
            raise InputError(f"'control_points' is of shape {points.shape}; give shape {shape}")
        points = points.astype(jax.numpy.result_type(jax.numpy.float32, points))
        parts, order, added = constants(points.dtype)
        found = [_map().bind(points, *part, n=len(part[1]), n_back=shape[0], is_transposed=False) for part in parts]
        whole = jax.numpy.concatenate(found)[order]
        return whole if added is None else whole + added

    return nodes


@dataclass(frozen=True, eq=False)
class _Group(OneLine):
    """The nodes of all volumes of the same orders."""

    ids: np.ndarray  # of int, number of each control point of the volumes, one volume after the other
    first: np.ndarray  # (n,) of int, position in ``ids`` of the first control point of the span of each node
    steps: tuple[np.ndarray, np.ndarray]  # each (n,) of int, positions from one to the next in directions 0 and 1
    functions: tuple[np.ndarray, ...]  # each (p, n), functions of the span of each node
    rows: np.ndarray  # (n,) of int, row of each node in the grid

    @cached_property
    def integers(self) -> tuple[np.ndarray, ...]:
        """The integers, in the order in which the primitive takes them."""
        return self.ids, self.first, *self.steps


def _groups(model: FittedModel) -> tuple[list[_Group], np.ndarray]:
    """Functions and control points of all evaluated nodes; rows that are copies, and their originals."""
    numbering = NodeNumbering.of_grid(model.topology)
    by_orders: dict[tuple[int, ...], list] = {}
    places = zip(model.mesh.volumes, model.mesh.control_ids, model.parameters_of(numbering), numbering.numbers)
    for volume, ids, parameters, rows in places:
        firsts, functions = [], []
        for d, knots in enumerate(volume.knots):
            spans, values = basis(knots, *(parameters[:, (d + offset) % 3] for offset in range(3)))
            firsts.append(spans - knots.order + 1)
            functions.append(values.T)
        by_orders.setdefault(tuple(volume.orders), []).append((volume.n_control, ids, firsts, functions, rows))
    return [_group(members) for members in by_orders.values()], numbering.copies


def _group(members: list) -> _Group:
    """Concatenate volumes."""
    ids, first, steps, start = [], [], ([], []), 0  # type: tuple[list, list, tuple[list, list], int]
    for (_, n_1, n_2), numbers, (i, j, k), _, rows in members:
        ids.append(np.ravel(numbers))
        first.append(start + (i * n_1 + j) * n_2 + k)
        steps[0].append(np.full(len(rows), n_1 * n_2))
        steps[1].append(np.full(len(rows), n_2))
        start += len(ids[-1])
    functions = tuple(np.ascontiguousarray(np.concatenate([m[3][d] for m in members], axis=1)) for d in range(3))
    rows = np.concatenate([m[4] for m in members])
    integers = [np.concatenate(part).astype(np.int32) for part in (ids, first, *steps)]
    return _Group(integers[0], integers[1], (integers[2], integers[3]), functions, rows)


@cache
def _map() -> Any:
    """Register the map from control points to nodes, both of shape (n, m), and its transpose."""
    jax, core = need_jax(), need_jax("jax.extend.core")
    ad, batching, mlir = (need_jax(f"jax.interpreters.{name}") for name in ("ad", "batching", "mlir"))
    primitive = core.Primitive("bspline_mdao_evaluation")

    def apply(x: Any, ids: Any, first: Any, *rest: Any, n: int, n_back: int, is_transposed: bool) -> Any:
        # rest: steps of directions 0 and 1, functions of three directions
        orders = [len(functions) for functions in rest[2:]]
        zeros = jax.numpy.zeros((len(ids) if is_transposed else n, x.shape[1]), x.dtype)
        net = x if is_transposed else x[ids]

        def term(number: Any, total: Any) -> Any:
            i, j, k = jax.numpy.unravel_index(number, orders)
            at = first + i * rest[0] + j * rest[1] + k
            weight = (rest[2][i] * rest[3][j] * rest[4][k])[:, None]
            return total.at[at].add(weight * net) if is_transposed else total + weight * net[at]

        found = jax.lax.fori_loop(0, int(np.prod(orders)), term, zeros)
        return jax.numpy.zeros((n_back, x.shape[1]), x.dtype).at[ids].add(found) if is_transposed else found

    def abstract(x: Any, *_: Any, n: int, n_back: int, is_transposed: bool) -> Any:
        return jax.core.ShapedArray((n_back if is_transposed else n, x.shape[1]), x.dtype)

    def jvp(primals: Any, tangents: Any, **settings: Any) -> tuple:
        found, change = primitive.bind(*primals, **settings), tangents[0]
        if type(change) is ad.Zero:
            return found, ad.Zero(jax.core.get_aval(found).to_tangent_aval())
        return found, primitive.bind(change, *primals[1:], **settings)

    def transpose(bar: Any, x: Any, *constants: Any, is_transposed: bool, **settings: Any) -> list:
        if type(bar) is ad.Zero:
            return [None] * (1 + len(constants))
        back = primitive.bind(bar, *constants, **settings, is_transposed=not is_transposed)
        return [back, *[None] * len(constants)]

    def batched(arrays: Any, axes: Any, **settings: Any) -> tuple:
        x = jax.numpy.moveaxis(arrays[0], axes[0], 1)  # members side by side, as columns
        found = primitive.bind(x.reshape(len(x), -1), *arrays[1:], **settings)
        return found.reshape(len(found), *x.shape[1:]), 1

    lowered = jax.jit(apply, static_argnames=("n", "n_back", "is_transposed"))
    primitive.def_impl(lowered)
    primitive.def_abstract_eval(abstract)
    ad.primitive_jvps[primitive] = jvp
    ad.primitive_transposes[primitive] = transpose
    batching.primitive_batchers[primitive] = batched
    mlir.register_lowering(primitive, mlir.lower_fun(apply, multiple_results=False))
    return primitive
