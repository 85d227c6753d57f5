"""Grids, quality and measures as PyTorch functions.

As in `.jax_functions` there are values, the product with the derivative, and the product with the transpose; each of
the last two is the derivative of the other. They are two ``torch.autograd.Function``, which have forward mode, reverse
mode and ``vmap``, so the transformations of ``torch.func`` work as well. PyTorch is imported when the first function is
made.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from ...base.extras import library
from ...errors import InputError
from ..design.parametrization import Parametrization
from ..measures.measure import Measure
from ..mesh.surface import SurfaceGrid
from ..model.movable import Movable
from ..movement.mover import Mover
from .batches import Batches
from .functions import grid_function, measures_function, quality_function

__all__ = ["grid", "measures", "quality"]


def grid(
    model: Movable,
    parametrization: Parametrization | None = None,
    *,
    mover: Mover | None = None,
    surface: SurfaceGrid | None = None,
    numbers: Sequence[int] | np.ndarray | None = None,
    memory: int = 1,
) -> Callable:
    """Make the grid a PyTorch function of control points, of prescribed surface nodes, or of design variables.

    It is the chain of `GridMovement` without a fit in one call, with results equal to the last bit. It works with
    ``backward``, in forward mode, and under ``torch.func``'s ``grad``, ``jvp``, ``vjp`` and ``vmap``, and has no second
    derivatives. It is computed on the CPU, and its result is on the device of its argument.

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
        How many designs are stored for derivatives: as many as ``vmap``, or a batch, has, if their gradients are
        needed. Designs that are not stored are computed again.

    Returns
    -------
    callable
        Function of control points (m), shape (n_control_points, 3), if there is neither a parametrization nor a
        surface. It returns the grid nodes (m), shape (n_nodes, 3).

    Raises
    ------
    InputError
        If PyTorch is not installed, or the arguments conflict; the function raises it for tensors of wrong shape, and
        `MovementError` for a design that cannot be moved.

    Examples
    --------
    >>> import torch  # doctest: +SKIP
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.torch import grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> points = torch.tensor(model.control_points, requires_grad=True)  # doctest: +SKIP
    >>> grid(model)(points)[:, 0].sum().backward()  # doctest: +SKIP
    >>> points.grad.shape  # doctest: +SKIP
    torch.Size([78, 3])
    """
    _need_torch()
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
    """Make the quality bounds of all cells a PyTorch function.

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
        If PyTorch is not installed, or there is no such bound.

    Examples
    --------
    >>> import torch  # doctest: +SKIP
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.torch import quality
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> nodes = torch.tensor(model.regenerate().to_vector().reshape(-1, 3))  # doctest: +SKIP
    >>> bool(quality(model, ["corner_ks"])(nodes)["corner_ks"] > 0.0)  # doctest: +SKIP
    True
    """
    _need_torch()
    return _function(quality_function(model, aggregates, rho=rho, p=p, rho_height=rho_height, memory=memory))


def measures(
    measures: Sequence[Measure],
    model: Movable | None = None,
    parametrization: Parametrization | None = None,
    *,
    memory: int = 1,
) -> Callable:
    """Make measures of a surface a PyTorch function.

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
        If PyTorch is not installed, or the measures are of several surfaces.

    Examples
    --------
    >>> import torch  # doctest: +SKIP
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import EnclosedVolume, SurfaceGrid
    >>> from bspline_mdao.torch import measures
    >>> surface = SurfaceGrid.of(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> measured = measures([EnclosedVolume.of(surface)])(torch.tensor(surface.points))  # doctest: +SKIP
    >>> round(float(measured["volume"][0]), 6)  # doctest: +SKIP
    1.0
    """
    _need_torch()
    return _function(measures_function(measures, model, parametrization, memory=memory))


def _need_torch() -> Any:
    """Import PyTorch, or say how to install it."""
    return library("torch", "functions of PyTorch need torch", "torch")


def _function(batches: Batches) -> Callable:
    """Make the function of a chain."""
    values, torch = _functions()[0], _need_torch()

    def function(given: Any) -> Any:
        points = [torch.as_tensor(point) for point in batches.taken(given)]
        batches.require_shapes([point.shape for point in points])
        dtype = points[0].dtype
        for point in points[1:]:
            dtype = torch.promote_types(dtype, point.dtype)
        if not dtype.is_floating_point:
            dtype = torch.get_default_dtype()
        return batches.returned(values.apply(batches, (), *(point.to(dtype) for point in points)))

    return function


def _tensors(like: Any, found: Sequence[np.ndarray]) -> tuple:
    """Tensors of arrays, of the kind and on the device of another one."""
    torch = _need_torch()
    return tuple(torch.from_numpy(np.asarray(part, order="C")).to(like) for part in found)


def _arrays(tensors: Sequence[Any]) -> list[np.ndarray]:
    return [tensor.detach().cpu().double().numpy() for tensor in tensors]


def _filled(batch: tuple[int, ...], tensors: Sequence[Any], shapes: Sequence[tuple[int, ...]], like: Any) -> list:
    """Zeros for what is None."""
    return [like.new_zeros((*batch, *shape)) if t is None else t for t, shape in zip(tensors, shapes)]


def _leading(info: Any, batch: tuple[int, ...], axes: Sequence[int | None], tensors: Sequence[Any]) -> tuple:
    """The batch with the axis that ``vmap`` adds, and tensors with it in front."""
    moved = [t[None] if axis is None else t.movedim(axis, 0) for t, axis in zip(tensors, axes)]
    return (info.batch_size, *batch), moved


@cache
def _functions() -> tuple[Any, Any]:
    """Functions of values and of products; their first arguments are the chain and the lengths of leading axes."""
    function: Any = _need_torch().autograd.Function

    class Values(function):  # type: ignore[misc]
        """Values at a batch of points."""

        @staticmethod
        def forward(batches: Batches, batch: tuple[int, ...], *points: Any) -> tuple:
            return _tensors(points[0], batches.values(batch, _arrays(points)))

        @staticmethod
        def setup_context(ctx: Any, inputs: tuple, output: tuple) -> None:
            ctx.batches, ctx.batch, *points = inputs
            ctx.save_for_backward(*points)
            ctx.save_for_forward(*points)
            ctx.set_materialize_grads(False)

        @staticmethod
        def backward(ctx: Any, *bars: Any) -> tuple:
            points, shapes = ctx.saved_tensors, list(ctx.batches.outputs.values())
            filled = _filled(ctx.batch, bars, shapes, points[0])
            return None, None, *Products.apply(ctx.batches, ctx.batch, True, *points, *filled)

        @staticmethod
        def jvp(ctx: Any, _batches: None, _batch: None, *changes: Any) -> tuple:
            points, shapes = ctx.saved_tensors, list(ctx.batches.inputs.values())
            filled = _filled(ctx.batch, changes, shapes, points[0])
            return Products.apply(ctx.batches, ctx.batch, False, *points, *filled)

        @staticmethod
        def vmap(info: Any, axes: tuple, batches: Batches, batch: tuple[int, ...], *points: Any) -> tuple:
            batch, moved = _leading(info, batch, axes[2:], points)
            return Values.apply(batches, batch, *moved), (0,) * len(batches.outputs)

    class Products(function):  # type: ignore[misc]
        """Products of vectors with the derivative, or with its transpose: linear in the vectors."""

        @staticmethod
        def forward(batches: Batches, batch: tuple[int, ...], is_transposed: bool, *tensors: Any) -> tuple:
            arrays, n = _arrays(tensors), len(batches.inputs)
            return _tensors(tensors[0], batches.products(batch, arrays[:n], arrays[n:], is_transposed))

        @staticmethod
        def setup_context(ctx: Any, inputs: tuple, output: tuple) -> None:
            ctx.batches, ctx.batch, ctx.is_transposed, *tensors = inputs
            n = len(ctx.batches.inputs)
            ctx.shapes = [tensor.shape for tensor in tensors[n:]]
            ctx.save_for_backward(*tensors[:n])
            ctx.save_for_forward(*tensors[:n])
            ctx.set_materialize_grads(False)

        @staticmethod
        def backward(ctx: Any, *bars: Any) -> tuple:
            points, n = ctx.saved_tensors, len(ctx.batches.inputs)
            if any(ctx.needs_input_grad[3 : 3 + n]):
                raise InputError("functions of grids have no second derivatives; detach what is differentiated twice")
            given = (ctx.batches.inputs if ctx.is_transposed else ctx.batches.outputs).values()
            filled = _filled(ctx.batch, bars, list(given), points[0])
            back = Products.apply(ctx.batches, ctx.batch, not ctx.is_transposed, *points, *filled)
            return None, None, None, *[None] * n, *(bar.sum_to_size(shape) for bar, shape in zip(back, ctx.shapes))

        @staticmethod
        def jvp(ctx: Any, _batches: None, _batch: None, _is_transposed: None, *changes: Any) -> tuple:
            points, n = ctx.saved_tensors, len(ctx.batches.inputs)
            if any(change is not None for change in changes[:n]):
                raise InputError("functions of grids have no second derivatives; detach what is differentiated twice")
            taken = (ctx.batches.outputs if ctx.is_transposed else ctx.batches.inputs).values()
            filled = _filled(ctx.batch, changes[n:], list(taken), points[0])
            return Products.apply(ctx.batches, ctx.batch, ctx.is_transposed, *points, *filled)

        @staticmethod
        def vmap(
            info: Any, axes: tuple, batches: Batches, batch: tuple[int, ...], is_transposed: bool, *tensors: Any
        ) -> tuple:
            batch, moved = _leading(info, batch, axes[3:], tensors)
            n_given = len(batches.inputs if is_transposed else batches.outputs)
            return Products.apply(batches, batch, is_transposed, *moved), (0,) * n_given

    return Values, Products
