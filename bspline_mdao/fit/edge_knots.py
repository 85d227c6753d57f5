"""Knots on the edges of a block from the parameters of its nodes, section II.D."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..splines.knots import BilinearKnots, ConstantKnots, Knots

KNOT_KINDS = ("curved", "constant")
"""Blend the knots of the four parallel edges bilinearly, Eq. (5), or take their mean."""

NARROWEST = 1e-10
"""Knot spans narrower than this (coincident nodes on an edge) make the edge's knots lean towards uniform ones."""

LEANING = 1e-3
"""Share of the uniform knots where an edge's own knots coincide."""


def edge_knots(parameters: np.ndarray, n_control: int, order: int) -> np.ndarray:
    """Open knots with about the same number of nodes in every span, section II.D.

    Inner knot ``T_i`` (i = p + 1 .. N) lies at the real node number ``q_i = (L - 1) (i - p) / (N + 1 - p)``, counted
    from 0, between the parameters of the two nodes around it.

    Parameters
    ----------
    parameters : ndarray, shape (L,)
        Parameters of the nodes of the edge, from 0 to 1.
    n_control, order : int
        Number of control points N and order p.

    Returns
    -------
    ndarray, shape (N + p,)

    Examples
    --------
    >>> edge_knots(np.array([0.0, 0.1, 0.3, 0.6, 1.0]), n_control=4, order=3)
    array([0. , 0. , 0. , 0.3, 1. , 1. , 1. ])
    """
    n_spans = n_control + 1 - order
    at = np.arange(n_spans + 1) * ((parameters.size - 1) / n_spans)
    breaks = np.interp(at, np.arange(parameters.size), parameters)
    if np.diff(breaks).min() < NARROWEST:
        breaks = (1 - LEANING) * breaks + LEANING * np.linspace(0, 1, n_spans + 1)
    return np.concatenate([np.zeros(order), breaks[1:-1], np.ones(order)])


def knots_of_segment(parameters: np.ndarray, n_control, orders, kind: str = "curved") -> tuple[Knots, Knots, Knots]:
    """Knots of the three directions of a segment from the parameters on its twelve edges.

    Parameters
    ----------
    parameters : ndarray, shape (L0, L1, L2, 3)
        Parameters of the nodes.
    n_control, orders : sequence of three int
        Number of control points and order in each direction.
    kind : str
        One of `KNOT_KINDS`.

    Returns
    -------
    tuple of three Knots

    Raises
    ------
    InputError
        If the kind is unknown.
    """
    if kind not in KNOT_KINDS:
        raise InputError(f'knots: "{kind}" is unknown; use one of {", ".join(KNOT_KINDS)} or give knots')
    return tuple(_direction_knots(parameters, d, n_control[d], orders[d], kind) for d in range(3))


def _direction_knots(parameters: np.ndarray, d: int, n_control: int, order: int, kind: str) -> Knots:
    if n_control == 1:
        return ConstantKnots.uniform(1, 1)
    # axes in the cyclic order of the knots: (d, d + 1, d + 2)
    lines = parameters[..., d].transpose(d, (d + 1) % 3, (d + 2) % 3)
    corners = np.array([[edge_knots(lines[:, s, t], n_control, order) for t in (0, -1)] for s in (0, -1)])
    return BilinearKnots(corners, order) if kind == "curved" else ConstantKnots(corners.mean(axis=(0, 1)), order)
