"""Parameters of the nodes of a block from powers of its chord lengths, or the user's own, section II.D.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from ...errors import InputError
from ...grids.topology.index_space import whole_slices
from ...grids.topology.topology import Link, Topology

LARGEST_DIFFERENCE = 1e-9
"""Largest difference of the user's parameters of a node that two segments share, or of their sum from one if a
direction runs backwards."""

COLLAPSED = 1e-12
"""A grid line shorter than this fraction of the block's size counts as collapsed; its parameters are uniform."""


def chord_length_parameters(
    nodes: np.ndarray,  # (L0, L1, L2, 3), nodes, in metres
    exponent: float = 1.0,  # power of the chords, see `bspline_mdao.core.fit.options.EXPONENTS`
) -> np.ndarray:  # (L0, L1, L2, 3), parameters xi, eta and zeta, exactly 0 and 1 at the two ends of every line
    """Parameters of all nodes from powers of chord lengths, section II.D.

    Examples
    --------
    >>> nodes = np.zeros((3, 1, 1, 3))
    >>> nodes[:, 0, 0, 0] = [0.0, 1.0, 4.0]
    >>> chord_length_parameters(nodes)[:, 0, 0]
    array([[0.  , 0.  , 0.  ],
           [0.25, 0.  , 0.  ],
           [1.  , 0.  , 0.  ]])
    """
    # Each grid line is parametrized on its own: ``xi_q`` is the sum of the powers of its chords up to node q divided by
    # the sum of all. A line without length gets uniform parameters, a direction of one node the parameter 0.
    parameters = np.zeros(nodes.shape)
    smallest = _smallest_length(nodes, exponent)
    for d in range(3):
        if nodes.shape[d] > 1:
            _parametrize_lines(np.moveaxis(nodes, d, 2), exponent, smallest, np.moveaxis(parameters[..., d], d, 2))
    return parameters


def chord_length_parameters_jvp(
    # nodes and their parameters
    nodes: np.ndarray,  # (L0, L1, L2, 3)
    parameters: np.ndarray,  # (L0, L1, L2, 3)
    d_nodes: np.ndarray,  # (L0, L1, L2, 3), direction
    exponent: float = 1.0,  # power of the chords
) -> np.ndarray:
    """Differentiate `chord_length_parameters` along a direction."""
    # returns (L0, L1, L2, 3), zero at the ends of all lines and on lines without length; chords without length count as
    # constant
    smallest, d_parameters = _smallest_length(nodes, exponent), np.zeros(nodes.shape)
    for d in range(3):
        if nodes.shape[d] > 1:
            lines = (np.moveaxis(array, d, 2) for array in (nodes, parameters[..., d], d_nodes, d_parameters[..., d]))
            _lines_jvp(*lines, exponent, smallest)
    return d_parameters


def chord_length_parameters_vjp(
    nodes: np.ndarray, parameters: np.ndarray, bar: np.ndarray, exponent: float = 1.0
) -> np.ndarray:
    """Transpose of `chord_length_parameters_jvp`: from ``bar`` of the parameters to the nodes' cotangent."""
    smallest, nodes_bar = _smallest_length(nodes, exponent), np.zeros(nodes.shape)
    for d in range(3):
        if nodes.shape[d] > 1:
            lines = (np.moveaxis(array, d, 2) for array in (nodes, parameters[..., d], bar[..., d], nodes_bar))
            _lines_vjp(*lines, exponent, smallest)
    return nodes_bar


def as_parameters(
    topology: Topology,  # segments and links
    # parameters xi, eta and zeta of the nodes of every block, or of every segment
    values: Sequence[np.ndarray],  # each (L0, L1, L2, 3)
) -> list[np.ndarray]:  # each (L0, L1, L2, 3), of every segment, from 0 to 1 in each
    """Check the user's own parameters, and split them where blocks are cut."""
    try:
        arrays = [np.array(array, dtype=float) for array in values]
    except (TypeError, ValueError):
        raise InputError(
            f"{topology.source}: parameters that are not arrays of numbers; give one for each block"
        ) from None
    shapes = [array.shape for array in arrays]
    segments = topology.segments
    if shapes == [(*shape, 3) for shape in topology.shapes]:
        names = [f"block {number}" for number in range(1, len(shapes) + 1)]
        for name, array in zip(names, arrays):
            _require_rising(f"{topology.source}: parameters of {name}", array)
        arrays = [_part(arrays[window.block][window.slices]) for window in segments]
    elif shapes != [(*window.shape, 3) for window in segments]:
        wanted = ", ".join(str((*shape, 3)) for shape in topology.shapes[:4])
        raise InputError(
            f"{topology.source}: parameters of shapes {', '.join(map(str, shapes[:4])) or 'none'}; give one array for "
            f"each block: {wanted}{', ...' if len(topology.shapes) > 4 else ''}"
        )
    for name, array in zip(topology.segment_names, arrays):
        _require_rising(f"{topology.source}: parameters of {name}", array)
    _require_agreement(topology, arrays)
    return arrays


def _part(parameters: np.ndarray) -> np.ndarray:
    """Stretch the parameters of a part of a block to the whole range, line by line."""
    parameters = parameters.copy()
    for d in (d for d in range(3) if parameters.shape[d] > 1):
        lines = np.moveaxis(parameters[..., d], d, 0)
        lines[...] = (lines - lines[0]) / (lines[-1] - lines[0])
    return parameters


def _require_rising(what: str, parameters: np.ndarray) -> None:
    """Refuse parameters that do not rise strictly from exactly 0 to exactly 1 along every grid line."""
    for d in range(3):
        lines = np.moveaxis(parameters[..., d], d, 0)
        if len(lines) == 1:
            is_bad = lines != 0
            rule = "be 0 in a direction of one node"
        else:
            is_bad = np.concatenate([lines[:1] != 0, ~(np.diff(lines, axis=0) > 0)])
            is_bad[-1] |= lines[-1] != 1
            rule = "rise from exactly 0 to exactly 1 along every grid line"
        if is_bad.any():
            place = np.argwhere(np.moveaxis(is_bad, 0, d))[0]
            value = parameters[..., d][tuple(place)]
            i, j, k = place + 1
            raise InputError(f"{what}: {value:g} in direction {'ijk'[d]} at node ({i}, {j}, {k}); they have to {rule}")


def _require_agreement(topology: Topology, parameters: Sequence[np.ndarray]) -> None:
    """Refuse parameters that differ where segments share nodes."""
    for link in topology.alike:
        first, second = parameters[link.a][whole_slices(link.a_section)], parameters[link.b]
        second = link.orientation.apply(second[whole_slices(link.b_section)])
        for d in (d for d in range(3) if link.a_section[d] is None):
            other = second[..., link.orientation.perm[d]]
            gaps = np.abs(first[..., d] - (1 - other if link.orientation.flip[d] else other))
            if gaps.max() > LARGEST_DIFFERENCE:
                place = np.unravel_index(np.argmax(gaps), gaps.shape)
                raise _disagreement(topology, link, d, [int(n) for n in place], gaps.max())


def _disagreement(topology: Topology, link: Link, d: int, place: Sequence[int], gap: float) -> InputError:
    """Name a node to which two segments give different parameters."""
    shape, names = topology.segments[link.a].shape, topology.segment_names
    ends = [n - 1 if end == -1 else 0 for n, end in zip(shape, link.a_section)]
    i, j, k = (n + end + 1 for n, end in zip(place, ends))
    return InputError(
        f"{topology.source}: parameters of {names[link.a]} and {names[link.b]} differ by {gap:.2g} at a node that they "
        f"share, ({i}, {j}, {k}) of {names[link.a]} in direction {'ijk'[d]}; give it the same"
    )


def _smallest_length(nodes: np.ndarray, exponent: float) -> float:
    """Sum of powers of chords below which a line counts as collapsed."""
    return (COLLAPSED * float(np.linalg.norm(np.ptp(nodes.reshape(-1, 3), axis=0)))) ** exponent


@njit(cache=True)
def _parametrize_lines(nodes, exponent, smallest, parameters):
    """Write the parameters of the grid lines along axis 2."""
    n_0, n_1, n_line = parameters.shape
    for i in range(n_0):
        for j in range(n_1):
            length = 0.0
            for q in range(1, n_line):
                dx = nodes[i, j, q, 0] - nodes[i, j, q - 1, 0]
                dy = nodes[i, j, q, 1] - nodes[i, j, q - 1, 1]
                dz = nodes[i, j, q, 2] - nodes[i, j, q - 1, 2]
                chord = np.sqrt(dx * dx + dy * dy + dz * dz)
                length += chord if exponent == 1.0 else chord**exponent
                parameters[i, j, q] = length
            for q in range(1, n_line):
                parameters[i, j, q] = parameters[i, j, q] / length if length > smallest else q / (n_line - 1)


@njit(cache=True)
def _chord_slope(nodes, i, j, q, exponent):
    """Derivative of the power of the chord from node q - 1 to node q in node q, and the power; no slope if it is 0."""
    dx = nodes[i, j, q, 0] - nodes[i, j, q - 1, 0]
    dy = nodes[i, j, q, 1] - nodes[i, j, q - 1, 1]
    dz = nodes[i, j, q, 2] - nodes[i, j, q - 1, 2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    power = length if exponent == 1.0 else length**exponent
    factor = exponent * power / (length * length) if length > 0.0 else 0.0
    return dx * factor, dy * factor, dz * factor, power


@njit(cache=True)
def _lines_jvp(nodes, parameters, d_nodes, d_parameters, exponent, smallest):
    """Write the derivatives of the parameters of the grid lines along axis 2."""
    n_0, n_1, n_line = parameters.shape
    for i in range(n_0):
        for j in range(n_1):
            length, d_length = 0.0, 0.0
            for q in range(1, n_line):
                ex, ey, ez, chord = _chord_slope(nodes, i, j, q, exponent)
                length += chord
                a, b = d_nodes[i, j, q], d_nodes[i, j, q - 1]
                d_length += ex * (a[0] - b[0]) + ey * (a[1] - b[1]) + ez * (a[2] - b[2])
                d_parameters[i, j, q] = d_length
            for q in range(1, n_line):
                change = d_parameters[i, j, q] - parameters[i, j, q] * d_length
                d_parameters[i, j, q] = change / length if length > smallest and q < n_line - 1 else 0.0


@njit(cache=True)
def _lines_vjp(nodes, parameters, bar, nodes_bar, exponent, smallest):
    """Add the cotangent of the nodes of the grid lines along axis 2."""
    n_0, n_1, n_line = parameters.shape
    for i in range(n_0):
        for j in range(n_1):
            length, total_bar = 0.0, 0.0
            for q in range(1, n_line):
                length += _chord_slope(nodes, i, j, q, exponent)[3]
                if q < n_line - 1:
                    total_bar -= bar[i, j, q] * parameters[i, j, q]
            if length <= smallest:
                continue
            chord_bar = total_bar  # for the chord that ends in node q: from all nodes from q on, and the total
            for q in range(n_line - 1, 0, -1):
                if q < n_line - 1:
                    chord_bar += bar[i, j, q]
                ex, ey, ez, _ = _chord_slope(nodes, i, j, q, exponent)
                factor = chord_bar / length
                nodes_bar[i, j, q, 0] += factor * ex
                nodes_bar[i, j, q, 1] += factor * ey
                nodes_bar[i, j, q, 2] += factor * ez
                nodes_bar[i, j, q - 1, 0] -= factor * ex
                nodes_bar[i, j, q - 1, 1] -= factor * ey
                nodes_bar[i, j, q - 1, 2] -= factor * ez
