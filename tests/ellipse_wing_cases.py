"""A wing of triangles that begins at a fuselage, whose sections are ellipses."""

import numpy as np

from bspline_mdao.core.mesh.frame import Plane
from bspline_mdao.measures import SurfaceGrid

SPAN, SWEEP, TAPER, THICK, BULGE = 3.0, 0.4, 0.3, 0.2, 0.5
"""Of a wing whose sections are ellipses, from 0.4 m beside the plane z = 0 on; its root bulges by the last."""


def chord_at(z):
    return 1.5 * (1.0 - TAPER * z / SPAN)


def wing(n_around=48, n_span=24):
    """Triangles of both sides, whose edge at the root goes outboard in the middle of the chord."""
    angle = 2.0 * np.pi * np.arange(n_around) / n_around
    part = np.linspace(0.0, 1.0, n_span)[:, None]
    root = 0.4 + BULGE * np.sin(angle) ** 2
    z = root + part * (SPAN - root)
    x = SWEEP * z + 0.5 * chord_at(z) * (1.0 - np.cos(angle))
    y = 0.5 * THICK * chord_at(z) * np.sin(angle)
    ids = np.arange(z.size).reshape(z.shape)
    a, b, c, d = ids[:-1], np.roll(ids, -1, axis=1)[:-1], np.roll(ids, -1, axis=1)[1:], ids[1:]
    triangles = np.concatenate([np.stack([a, c, b, b], axis=-1), np.stack([a, d, c, c], axis=-1)]).reshape(-1, 4)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    plane = Plane(np.array([0.0, 0.0, 1.0]), 0.0)
    return SurfaceGrid(points, np.arange(len(points)), (), ("wing",), ("wing",), (plane,), (triangles,))
