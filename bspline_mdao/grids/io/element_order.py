"""Order in which file formats list the nodes of curved hexahedra and quadrangles.

An element of degree d has a lattice of (d + 1)^3 nodes, or (d + 1)^2; formats begin with its corners,

::

        7---------6
       /|        /|        c  b
      4---------5 |        | /
      | |       | |        |/
      | 3-------|-2        +--- a
      |/        |/
      0---------1

then list the nodes inside edges, inside faces, and inside the element. CGNS (SIDS, section 3.3) goes round each face,
and inside it from ring to ring; Gmsh lists the inside of a face or of an element like an element of two degrees less.
Theory: ``docs/theory/high_order.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

__all__ = ["HEXAHEDRA", "QUADRANGLES", "cgns_order", "gmsh_order"]

HEXAHEDRA = {1: 17, 2: 19, 3: 39, 4: 56}
QUADRANGLES = {1: 7, 2: 9, 3: 28, 4: 44}
"""CGNS's numbers of the element types by degree (SIDS, section 7.3, and the library's ``cgnslib.h``)."""

Lattice = list[tuple[int, ...]]

CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
"""Places of the corners of a hexahedron; the first four are the corners of a quadrangle."""

CGNS_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4))
CGNS_FACES = ((0, 1, 2, 3), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7))
GMSH_EDGES = ((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7))
GMSH_FACES = ((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7))
"""Edges and faces by their corners, each from the first corner towards the second."""

QUAD_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0))


@cache
def cgns_order(degree: int, n_dimensions: int = 3) -> np.ndarray:
    """Places in the lattice, in C order, of the nodes of a CGNS quadrangle or hexahedron, in its order.

    Examples
    --------
    >>> [int(n) for n in cgns_order(2, 2)]
    [0, 6, 8, 2, 3, 7, 5, 1, 4]
    """
    if n_dimensions == 2:
        return _numbers(_around(degree) + _inner_rings(degree), degree)
    places = _corners(degree) + _on_edges(degree, CGNS_EDGES)
    for face in CGNS_FACES:
        places += _on_face(degree, face, _inner_rings(degree))
    for c in range(1, degree):
        places += [(*place, c) for place in _inner_rings(degree)]
    return _numbers(places, degree)


@cache
def gmsh_order(degree: int, n_dimensions: int = 3) -> np.ndarray:
    """Places in the lattice of the nodes of an element of Gmsh, in its order; see `cgns_order`.

    Examples
    --------
    >>> [int(n) for n in gmsh_order(2, 2)]
    [0, 6, 8, 2, 3, 7, 5, 1, 4]
    """
    return _numbers((_gmsh_quadrangle if n_dimensions == 2 else _gmsh_hexahedron)(degree), degree)


def _numbers(places: Lattice, degree: int) -> np.ndarray:
    """Numbers of places in the lattice, in C order."""
    numbers = np.ravel_multi_index(np.transpose(places), (degree + 1,) * len(places[0]))
    numbers.flags.writeable = False
    return numbers


def _corners(degree: int) -> Lattice:
    return [tuple(degree * m for m in corner) for corner in CORNERS]


def _on_edges(degree: int, edges: Sequence[tuple[int, int]]) -> Lattice:
    """Nodes inside edges."""
    places = []
    for ends in edges:
        first, last = (np.array(CORNERS[corner]) for corner in ends)
        places += [tuple(int(x) for x in (degree - m) * first + m * last) for m in range(1, degree)]
    return places


def _on_face(degree: int, face: Sequence[int], inner: Lattice) -> Lattice:
    """Nodes inside a face, from their places in a quadrangle with its corners."""
    origin, along, up = (np.array(CORNERS[face[m]]) for m in (0, 1, 3))
    return [tuple(int(x) for x in degree * origin + a * (along - origin) + b * (up - origin)) for a, b in inner]


def _around(degree: int) -> Lattice:
    """Corners of a quadrangle, then the nodes inside its edges."""
    places: Lattice = [tuple(degree * m for m in corner[:2]) for corner in CORNERS[:4]]
    for first, last in QUAD_EDGES:
        (a, b), (c, d) = CORNERS[first][:2], CORNERS[last][:2]
        places += [((degree - m) * a + m * c, (degree - m) * b + m * d) for m in range(1, degree)]
    return places


def _gmsh_quadrangle(degree: int) -> Lattice:
    """All nodes of a quadrangle; its inside is one of two degrees less."""
    if degree == 0:
        return [(0, 0)]
    return _around(degree) + (_within(_gmsh_quadrangle(degree - 2)) if degree > 1 else [])


def _inner_rings(degree: int) -> Lattice:
    """Nodes inside a quadrangle in the order of CGNS, ring after ring."""
    places: Lattice = []
    low, high = 1, degree - 1
    while low < high:
        n = high - low
        places += [(low + m, low) for m in range(n)] + [(high, low + m) for m in range(n)]
        places += [(high - m, high) for m in range(n)] + [(low, high - m) for m in range(n)]
        low, high = low + 1, high - 1
    return places + ([(low, low)] if low == high else [])


def _gmsh_hexahedron(degree: int) -> Lattice:
    """All nodes of a hexahedron; the insides of its faces and of itself are elements of two degrees less."""
    if degree == 0:
        return [(0, 0, 0)]
    places = _corners(degree) + _on_edges(degree, GMSH_EDGES)
    if degree > 1:
        inner = _within(_gmsh_quadrangle(degree - 2))
        places += [place for face in GMSH_FACES for place in _on_face(degree, face, inner)]
        places += _within(_gmsh_hexahedron(degree - 2))
    return places


def _within(inner: Lattice) -> Lattice:
    """Places of a lattice in the lattice of an element of two degrees more."""
    return [tuple(m + 1 for m in place) for place in inner]
