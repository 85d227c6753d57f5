"""Grids, quality and measures as JAX functions.

A function is one primitive with three kinds: its values, the product with its derivative, and the product with the
transpose. The last two are linear in their vectors, and each is the other's transpose, which is all JAX needs for
``jvp``, ``vjp``, ``grad`` and their combinations. Under ``vmap`` a batch crosses at once (`.batches`). JAX is imported
when the first function is made.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

import numpy as np

from ...base.extras import library
from ..design.parametrization import Parametrization
from ..measures.measure import Measure
from ..mesh.surface import SurfaceGrid
from ..model.movable import Movable
from ..movement.mover import Mover
from .batches import Batches
from .functions import grid_function, measures_function, quality_function

__all__ = ["grid", "measures", "need_jax", "quality"]

VALUES, FORWARD, TRANSPOSED = "values", "forward", "transposed"
"""Kinds of the primitive."""


def need_jax(module: str = "jax") -> Any:
    """Import JAX, or say how to install it."""
    return library(module, "functions of JAX need jax", "jax")


def grid(
    model: Movable,
    parametrization: Parametrization | None = None,
    *,
    mover: Mover | None = None,
    surface: SurfaceGrid | None = None,
    numbers: Sequence[int] | np.ndarray | None = None,
    memory: int = 1,
) -> Callable:
    """Make the grid a JAX function of control points, of prescribed surface nodes, or of design variables.

    It is the chain of `GridMovement` without a fit in one call, with results equal to the last bit. It works under
    ``jit``, ``jvp``, ``vjp``, ``grad`` and ``vmap``, and has no second derivatives.

    Parameters
    ----------
    model : FittedModel or MeshModel
        The fitted grid, or an unstructured mesh.
    parametrization : Parametrization, optional
        Design variables: the function takes a dict of them by name, each in its own units.
    mover : Mover, optional
        Moves the control mesh; by default as in `GridMovement`.
    surface : SurfaceGrid, optional
        Surface with prescribed nodes: the function takes their positions (m), shape (n, 3). With a parametrization of
        `DesignSurface.of_nodes` variables move these nodes.
    numbers : sequence of int, optional
        Which nodes of the surface are prescribed; all by default.
    memory : int
        How many designs are stored for derivatives: as many as ``vmap`` has, if their gradients are needed. Designs
        that are not stored are computed again.

    Returns
    -------
    callable
        Function of control points (m), shape (n_control_points, 3), if there is neither a parametrization nor a
        surface. It returns the grid nodes (m), shape (n_nodes, 3).

    Raises
    ------
    InputError
        If JAX is not installed, or the arguments conflict; the function raises it for arrays of wrong shape. A design
        that cannot be moved raises a JAX error with its message.

    Examples
    --------
    >>> import jax  # doctest: +SKIP
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.jax import grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> nodes = grid(model)  # doctest: +SKIP
    >>> jax.grad(lambda points: nodes(points)[:, 0].sum())(model.control_points).shape  # doctest: +SKIP
    (78, 3)
    """
    need_jax()
    options: dict[str, Any] = {"mover": mover, "surface": surface, "numbers": numbers, "memory": memory}
    return _function(grid_function(model, parametrization, **options))


def quality(
    model: Movable,
    aggregates: Sequence[str] | None = None,
    *,
    rho: float = 100.0,
    p: int = 64,
    rho_height: float = 1000.0,
    memory: int = 1,
) -> Callable:
    """Make the quality bounds of all cells a JAX function.

    Parameters
    ----------
    model : FittedModel or MeshModel
        The fitted grid, or an unstructured mesh.
    aggregates : sequence of str, optional
        Which bounds; the usual ones by default, see `Quality`.
    rho, p, rho_height
        Sharpness of the bounds, see `Quality`.
    memory : int
        See `grid`.

    Returns
    -------
    callable
        Function of the grid nodes (m), shape (n_nodes, 3), that returns a dict of the bounds by name.

    Raises
    ------
    InputError
        If JAX is not installed, or there is no such bound.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.jax import quality
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> bounds = quality(model, ["corner_ks"])  # doctest: +SKIP
    >>> float(bounds(model.regenerate().to_vector().reshape(-1, 3))["corner_ks"]) > 0.0  # doctest: +SKIP
    True
    """
    need_jax()
    return _function(quality_function(model, aggregates, rho=rho, p=p, rho_height=rho_height, memory=memory))


def measures(
    measures: Sequence[Measure],
    model: Movable | None = None,
    parametrization: Parametrization | None = None,
    *,
    memory: int = 1,
) -> Callable:
    """Make measures of a surface a JAX function.

    Parameters
    ----------
    measures : sequence of Measure
        Measures of one `SurfaceGrid`.
    model : FittedModel or MeshModel, optional
        With a parametrization the function takes design variables: their model.
    parametrization : Parametrization, optional
        The design variables.
    memory : int
        See `grid`.

    Returns
    -------
    callable
        Function of the surface nodes (m), shape (n, 3), which are ``nodes[surface.rows]`` of the grid nodes; or of a
        dict of design variables. It returns a dict of the measures by name.

    Raises
    ------
    InputError
        If JAX is not installed, or the measures are of several surfaces.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.jax import measures
    >>> from bspline_mdao.measures import EnclosedVolume, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> measured = measures([EnclosedVolume.of(surface)])  # doctest: +SKIP
    >>> float(measured(surface.points)["volume"][0].round(6))  # doctest: +SKIP
    1.0
    """
    need_jax()
    return _function(measures_function(measures, model, parametrization, memory=memory))


def _function(batches: Batches) -> Callable:
    """Make the function of a chain."""
    jnp, primitive = need_jax("jax.numpy"), _primitive()

    def function(given: Any) -> Any:
        points = [jnp.asarray(point) for point in batches.taken(given)]
        batches.require_shapes([point.shape for point in points])
        dtype = jnp.result_type(jnp.float32, *points)
        points = [point.astype(dtype) for point in points]
        return batches.returned(primitive.bind(*points, batches=batches, kind=VALUES, batch=()))

    return function


@cache
def _primitive() -> Any:
    """Register the primitive; its parameters are the function, the kind, and the lengths of the leading axes."""
    jax, core = need_jax(), need_jax("jax.extend.core")
    ad, batching, mlir = (need_jax(f"jax.interpreters.{name}") for name in ("ad", "batching", "mlir"))
    primitive = core.Primitive("bspline_mdao")
    primitive.multiple_results = True

    def shapes(batches: Batches, kind: str) -> list[tuple[int, ...]]:
        return list((batches.inputs if kind == TRANSPOSED else batches.outputs).values())

    def callback(*arrays: Any, batches: Batches, kind: str, batch: tuple[int, ...]) -> list:
        dtype, n = arrays[0].dtype, len(batches.inputs)

        def compute(*given: Any) -> tuple[np.ndarray, ...]:
            found = [np.asarray(array, dtype=float) for array in given]
            if kind == VALUES:
                parts = batches.values(batch, found)
            else:
                parts = batches.products(batch, found[:n], found[n:], kind == TRANSPOSED)
            return tuple(part.astype(dtype, copy=False) for part in parts)

        wanted = tuple(jax.ShapeDtypeStruct((*batch, *shape), dtype) for shape in shapes(batches, kind))
        return list(jax.pure_callback(compute, wanted, *arrays))

    def abstract(*arrays: Any, batches: Batches, kind: str, batch: tuple[int, ...]) -> list:
        return [jax.core.ShapedArray((*batch, *shape), arrays[0].dtype) for shape in shapes(batches, kind)]

    def filled(tangents: Sequence[Any]) -> list:
        return [ad.instantiate_zeros(tangent) for tangent in tangents]

    def jvp(primals: Sequence[Any], tangents: Sequence[Any], **settings: Any) -> tuple:
        n, kind = len(settings["batches"].inputs), settings["kind"]
        found = primitive.bind(*primals, **settings)
        if kind == VALUES:
            change = primitive.bind(*primals, *filled(tangents), **{**settings, "kind": FORWARD})
            return found, change
        if not all(type(tangent) is ad.Zero for tangent in tangents[:n]):
            raise NotImplementedError("bspline_mdao: functions of grids have no second derivatives")
        return found, primitive.bind(*primals[:n], *filled(tangents[n:]), **settings)

    def transpose(bars: Sequence[Any], *arrays: Any, batches: Batches, kind: str, batch: tuple[int, ...]) -> list:
        n = len(batches.inputs)
        other = FORWARD if kind == TRANSPOSED else TRANSPOSED
        back = primitive.bind(*arrays[:n], *filled(bars), batches=batches, kind=other, batch=batch)
        vectors = []
        for vector, bar in zip(arrays[n:], back):
            shape = vector.aval.shape
            shared = [axis for axis, length in enumerate(batch) if shape[axis] != length]
            vectors.append(bar.sum(axis=shared, keepdims=True) if shared else bar)
        return [None] * n + vectors

    def batched(arrays: Sequence[Any], axes: Sequence[Any], **settings: Any) -> tuple:
        length = next(array.shape[axis] for array, axis in zip(arrays, axes) if axis is not None)
        moved = [
            array[None] if axis is None else jax.numpy.moveaxis(array, axis, 0) for array, axis in zip(arrays, axes)
        ]
        found = primitive.bind(*moved, **{**settings, "batch": (length, *settings["batch"])})
        return found, [0] * len(found)

    primitive.def_impl(callback)
    primitive.def_abstract_eval(abstract)
    ad.primitive_jvps[primitive] = jvp
    ad.primitive_transposes[primitive] = transpose
    batching.primitive_batchers[primitive] = batched
    mlir.register_lowering(primitive, mlir.lower_fun(partial(callback), multiple_results=True))
    return primitive
