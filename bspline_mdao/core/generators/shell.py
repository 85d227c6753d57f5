r"""Grids of the shell between a closed body and a sphere far away: O-O topology without singular lines.

The blocks lie on the six sides of the body, or on the three sides of one octant of it. The parameters of a point on the
body are the coordinates on a cube, ``max(|s|) = 1``. Along k every grid line is straight, from the body to the sphere::

        +-----------+
        | \   z+  / |          i x j = k on every side:
        |  +-----+  |          x+: y, z     x-: z, y
        |x-| body|x+|          y+: z, x     y-: x, z
        |  +-----+  |          z+: x, y     z-: y, x
        | /   z-  \ |
        +-----------+

Theory: ``docs/theory/generators.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ...errors import InputError
from ...grids.topology.grid import Block, Grid, Patch
from ...grids.topology.index_space import Window
from .stretching import stretch_from

_I_MIN, _J_MIN, _K_MIN, _K_MAX = 0, 2, 4, 5


def ball_grid(
    shape: Sequence[int] = (17, 17, 17, 17),
    radius: float = 1.0,
    far: float = 10.0,
    off_wall: float | None = None,
    octant: bool = False,
) -> Grid:
    """Make the grid about a ball.

    Parameters
    ----------
    shape : tuple of four int
        Nodes of a block along x, y and z, and away from the body.
    radius, far : float
        Radii of the ball and of the outer boundary (m).
    off_wall : float, optional
        First interval off the wall (m); without it the intervals are equal.
    octant : bool
        Make only the octant of positive coordinates.

    Returns
    -------
    Grid
        Patches ``body`` (wall), ``farfield`` and, for an octant, ``symmetry_x``, ``symmetry_y`` and ``symmetry_z``. Six
        right-handed blocks, or three.

    Raises
    ------
    InputError
        If there are too few nodes, the outer boundary cuts the body, or ``off_wall`` does not fit.

    Examples
    --------
    >>> from bspline_mdao.generators import ball_grid
    >>> grid = ball_grid((5, 5, 5, 5), radius=1.0, far=10.0)
    >>> len(grid.blocks), [patch.name for patch in grid.patches]
    (6, ['body', 'farfield'])
    """
    away = _fractions(shape, far, radius, off_wall, "grid about a ball")
    return _shell(shape, lambda s: radius * _on_sphere(s), far, away, octant, "grid about a ball")


def brick_grid(
    shape: Sequence[int] = (17, 17, 17, 17),
    size: Sequence[float] = (1.0, 1.0, 1.0),
    far: float = 10.0,
    off_wall: float | None = None,
    octant: bool = False,
) -> Grid:
    """Make the grid about a rectangular brick, whose edges and corners are sharp.

    Parameters
    ----------
    shape : tuple of four int
        Nodes of a block along x, y and z, and away from the body.
    size : tuple of three float
        Lengths of the brick along x, y and z (m).
    far : float
        Radius of the outer boundary (m).
    off_wall : float, optional
        First interval off the wall (m) on lines as long as from the corners; without it the intervals of each line are
        equal.
    octant : bool
        Make only the octant of positive coordinates.

    Returns
    -------
    Grid
        Patches as in `ball_grid`.

    Raises
    ------
    InputError
        If there are too few nodes, the outer boundary cuts the body, or ``off_wall`` does not fit.

    Examples
    --------
    >>> from bspline_mdao.generators import brick_grid
    >>> grid = brick_grid((5, 5, 5, 5), size=(2.0, 1.0, 1.0), far=10.0)
    >>> len(grid.blocks), [patch.name for patch in grid.patches]
    (6, ['body', 'farfield'])
    """
    half = 0.5 * np.asarray(size, dtype=np.float64)
    away = _fractions(shape, far, float(np.linalg.norm(half)), off_wall, "grid about a brick")
    return _shell(shape, lambda s: half * s, far, away, octant, "grid about a brick")


def _shell(
    shape: Sequence[int],
    body: Callable[[np.ndarray], np.ndarray],
    far: float,
    away: np.ndarray,
    octant: bool,
    source: str,
) -> Grid:
    """Fill the blocks: ``body`` maps the cube, shape (..., 3), to the body, ``away`` are fractions along the lines."""
    sides = [(axis, 1) for axis in range(3)] if octant else [(axis, sign) for axis in range(3) for sign in (1, -1)]
    blocks = []
    for axis, sign in sides:
        side = _cube_side(shape, axis, sign, 0.0 if octant else -1.0)[:, :, None]
        nodes = (1.0 - away) * body(side) + away * far * _on_sphere(side)
        blocks.append(Block(np.ascontiguousarray(nodes), f"{'xyz'[axis]}{'+-'[sign < 0]}"))
    return Grid(tuple(blocks), _patches(blocks, octant), source=source)


def _patches(blocks: list[Block], octant: bool) -> tuple[Patch, ...]:
    """The body, the outer boundary, and the planes that an octant ends on."""
    whole = [Window.whole(number, block.shape) for number, block in enumerate(blocks)]
    body, far = (tuple(window.face(face) for window in whole) for face in (_K_MIN, _K_MAX))
    patches = [Patch("body", "wall", body), Patch("farfield", "farfield", far)]
    for axis in range(3) if octant else ():
        windows = whole[axis - 1].face(_I_MIN), whole[axis - 2].face(_J_MIN)
        patches.append(Patch(f"symmetry_{'xyz'[axis]}", "symmetry", windows))
    return tuple(patches)


def _fractions(shape: Sequence[int], far: float, reach: float, off_wall: float | None, source: str) -> np.ndarray:
    """Nodes along a line from 0 to 1, shape (n, 1); ``reach`` is the extent of the body."""
    if len(shape) != 4 or min(shape) < 3:
        raise InputError(f"{source}: shape {tuple(shape)}; give four counts of 3 nodes at least")
    if far <= reach:
        raise InputError(f"{source}: the outer boundary of radius {far:g} m cuts the body; give more than {reach:g} m")
    if off_wall is None:
        return np.linspace(0.0, 1.0, shape[3])[:, None]
    return stretch_from(shape[3], off_wall / (far - reach))[:, None]


def _cube_side(shape: Sequence[int], axis: int, sign: int, low: float) -> np.ndarray:
    """Equidistant points of one side of the cube, shape (ni, nj, 3), from ``low`` to 1."""
    first, second = ((axis + 1) % 3, (axis + 2) % 3)[::sign]
    points = np.empty((shape[first], shape[second], 3))
    points[..., first] = np.linspace(low, 1.0, shape[first])[:, None]
    points[..., second] = np.linspace(low, 1.0, shape[second])
    points[..., axis] = sign
    return points


def _on_sphere(points: np.ndarray) -> np.ndarray:
    """Unit vectors through points of the cube at equal angles."""
    stretched = np.tan(0.25 * np.pi * points)
    return stretched / np.linalg.norm(stretched, axis=-1, keepdims=True)
