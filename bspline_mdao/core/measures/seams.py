"""Smoothness of a surface across its seams and at its poles: angles between tangent planes, curvatures on both sides.

At places along a seam, ``n`` is the unit normal of a side, ``T`` the unit tangent of the seam and ``h = n x T`` the
direction across it in the tangent plane. The normal curvature in that direction is ``II(d, d)`` where
``S_u d_u + S_v d_v = h``; positive where the surface bends towards its normal, into the fluid.
Theory: ``docs/theory/linear_constraints.rst``.

References
----------
M. P. do Carmo, *Differential Geometry of Curves and Surfaces*, 1976: normal curvature from the second fundamental form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.checks import as_finite_points, require_kind
from ...base.display import OneLine
from ...base.numerics.vectors import dots, lengths
from ...errors import InputError
from ..mesh.boundary import symmetry_planes
from ..mesh.seams import Pole, Seam, SideEdge, find_mirror_seams, find_poles, find_seams
from ..mesh.spline_sides import SplineSide, spline_sides
from ..model.fitted_model import FittedModel

__all__ = ["PoleContinuity", "SeamContinuity", "pole_continuity", "seam_continuity"]

NO_PLANE = 1e-6
"""Sine between the two derivatives of a side, or their length relative to the longest, at which it has no tangent
plane."""


@dataclass(frozen=True, eq=False)
class SeamContinuity(OneLine):
    """Smoothness across one seam.

    Parameters
    ----------
    names : tuple of str
        The two sides: block, side and patch. The second may be the mirror image of the first.
    points : ndarray, shape (n, 3)
        Places along the seam (m).
    kinks : ndarray, shape (n,)
        Angles between the two tangent planes (deg): 0 where the surface is smooth, 180 where it folds back on itself.
    curvatures : ndarray, shape (n, 2)
        Normal curvature across the seam on each side (1/m).
    number : int
        Number of the seam, independent of how control points move.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import ball_grid
    >>> from bspline_mdao.measures import seam_continuity
    >>> seam = seam_continuity(fit_grid(ball_grid((9, 9, 9, 9))))[0]
    >>> seam.points.shape, bool(seam.max_kink < 1.0)
    ((21, 3), True)
    """

    names: tuple[str, str]
    points: np.ndarray
    kinks: np.ndarray
    curvatures: np.ndarray
    number: int

    @property
    def max_kink(self) -> float:
        """Largest angle between the two tangent planes (deg)."""
        return float(self.kinks.max(initial=0.0))

    @property
    def max_jump(self) -> float:
        """Largest difference between the curvatures of both sides (1/m); meaningful only without a kink."""
        return float(np.abs(np.diff(self.curvatures, axis=1)).max(initial=0.0))


def seam_continuity(
    model: FittedModel,
    control_points: np.ndarray | None = None,
    patches: str | Sequence[str] | None = None,
    n_places: int = 21,
    *,
    mirror: bool = False,
) -> tuple[SeamContinuity, ...]:
    """Measure kinks and curvatures across all seams between sides of blocks on a surface.

    Parameters
    ----------
    model : FittedModel
        The model, whose splines are measured without the residual.
    control_points : ndarray, shape (n_control_points, 3), optional
        Moved control points (m); the fitted ones by default.
    patches : str or sequence of str, optional
        Patches by name or pattern (``"wing*"``); all walls by default.
    n_places : int
        Number of places along each seam, without its ends; places without a tangent plane on a side are left out.
    mirror : bool
        Include edges in symmetry planes, as seams between a side and its mirror image.

    Returns
    -------
    tuple of SeamContinuity
        Seams, the largest kink first.

    Raises
    ------
    InputError
        If a patch does not exist, no patch is a wall, or there is no place.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import ball_grid
    >>> from bspline_mdao.measures import seam_continuity
    >>> seams = seam_continuity(fit_grid(ball_grid((9, 9, 9, 9))))
    >>> len(seams)  # the edges of a cube
    12
    """
    sides = _sides(model, control_points, patches)
    if n_places < 1:
        raise InputError(f"seams: {n_places} places along each; ask for at least 1")
    t = np.arange(1, n_places + 1) / (n_places + 1)
    names, pairs = [side.name for side in sides], [(side.surface, side.ids) for side in sides]
    seams = find_seams(pairs)
    if mirror:
        seams += find_mirror_seams(pairs, symmetry_planes(model))
    found = [_measured(seam, t, names, number) for number, seam in enumerate(seams)]
    return tuple(sorted(found, key=lambda seam: -seam.max_kink))


@dataclass(frozen=True, eq=False)
class PoleContinuity(OneLine):
    """Smoothness at a pole, where edges of sides have collapsed.

    Parameters
    ----------
    names : tuple of str
        The sides that meet there: block, side and patch.
    point : ndarray, shape (3,)
        The pole (m).
    kink : float
        Largest angle between a direction of the surface out of the pole and the plane nearest to all directions (deg).

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.measures import pole_continuity
    >>> pole_continuity(fit_grid(onera_m6_grid((9, 9, 7))))  # no edge of it has collapsed to a point
    ()
    """

    names: tuple[str, ...]
    point: np.ndarray
    kink: float


def pole_continuity(
    model: FittedModel,
    control_points: np.ndarray | None = None,
    patches: str | Sequence[str] | None = None,
    n_places: int = 21,
) -> tuple[PoleContinuity, ...]:
    """Measure the deviation from one tangent plane at points where edges of a surface's sides have collapsed.

    Parameters
    ----------
    model, control_points, patches
        As for `seam_continuity`.
    n_places : int
        Number of directions out of the pole on each side.

    Returns
    -------
    tuple of PoleContinuity
        Poles, the largest kink first.

    Raises
    ------
    InputError
        As `seam_continuity`.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import ball_grid
    >>> from bspline_mdao.measures import pole_continuity
    >>> pole_continuity(fit_grid(ball_grid((9, 9, 9, 9))))  # six sides, and no pole
    ()
    """
    sides = _sides(model, control_points, patches)
    if n_places < 1:
        raise InputError(f"poles: {n_places} directions on each side; ask for at least 1")
    poles = find_poles([(side.surface, side.ids) for side in sides])
    found = [_flatness(pole, sides, np.linspace(0.0, 1.0, n_places)) for pole in poles]
    return tuple(sorted(found, key=lambda pole: -pole.kink))


def _sides(
    model: FittedModel, control_points: np.ndarray | None, patches: str | Sequence[str] | None
) -> list[SplineSide]:
    """Sides on the surface of a model, possibly with moved control points."""
    require_kind(model, FittedModel, "the model of seams", "make it with fit_grid(grid)")
    points = model.control_points
    if control_points is not None:
        points = as_finite_points(control_points, len(points), f"{model.header.source}: control points")
    return spline_sides(model, points, patches)


def _flatness(pole: Pole, sides: Sequence[SplineSide], t: np.ndarray) -> PoleContinuity:
    """Largest angle between a direction out of a pole and the plane of all."""
    out = np.concatenate([edge.side.gradients(*edge.uv(t))[..., edge.axis] * edge.inward for edge in pole.edges])
    size = lengths(out)
    directions = out[size > NO_PLANE * size.max(initial=0.0)]
    directions /= lengths(directions)[:, None]
    kink = 0.0
    if len(directions) > 2:
        normal = np.linalg.svd(directions, full_matrices=False)[2][-1]
        kink = float(np.degrees(np.arcsin(np.abs(directions @ normal).max().clip(0.0, 1.0))))
    edge = pole.edges[0]
    names = tuple(dict.fromkeys(sides[each.number].name for each in pole.edges))
    return PoleContinuity(names, edge.side.points(*edge.uv(t[:1]))[0], kink)


def _measured(seam: Seam, t: np.ndarray, names: Sequence[str], number: int) -> SeamContinuity:
    normals, curvatures, has_plane = zip(*(_on_side(edge, t) for edge in (seam.first, seam.second)))
    both = has_plane[0] & has_plane[1]
    kinks = np.degrees(np.arctan2(lengths(np.cross(*normals)), dots(*normals)))
    second = names[seam.second.number] if seam.mirror is None else "its mirror image"
    return SeamContinuity(
        (names[seam.first.number], second),
        seam.first.side.points(*seam.first.uv(t))[both],
        kinks[both],
        np.stack(curvatures, axis=1)[both],
        number,
    )


def _on_side(edge: SideEdge, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit normals, curvatures across the seam, and whether there is a tangent plane, at places along a seam."""
    uv = edge.uv(t)
    gradients, hessians = edge.side.gradients(*uv), edge.side.hessians(*uv)
    s_u, s_v = gradients[..., 0], gradients[..., 1]
    crossed, size = np.cross(s_u, s_v), lengths(gradients.swapaxes(1, 2))
    area = lengths(crossed)
    has_plane = (area > NO_PLANE * size.prod(axis=1)) & (size.min(axis=1) > NO_PLANE * size.max())
    normals = crossed / np.where(has_plane, area, 1.0)[:, None]
    tangent = gradients[..., 1 - edge.axis]
    across = np.cross(normals, tangent / np.where(has_plane, lengths(tangent), 1.0)[:, None])
    # d with S_u d_u + S_v d_v = across, by the dual basis
    safe = np.where(has_plane, area, 1.0)
    d_u = dots(np.cross(across, s_v), normals) / safe
    d_v = dots(np.cross(s_u, across), normals) / safe
    second = np.einsum("ndk,nd->nk", hessians, normals)
    return normals, second[:, 0] * d_u**2 + 2.0 * second[:, 1] * d_u * d_v + second[:, 2] * d_v**2, has_plane
