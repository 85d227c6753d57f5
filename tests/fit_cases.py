"""Grids for the tests of the fit: small, curved, of unequal sizes."""

from dataclasses import replace

import numpy as np

from bspline_mdao.core.fit import fitting
from bspline_mdao.core.fit.settings import FITTING
from bspline_mdao.grids.topology.grid import Block, Grid


def fit_with(monkeypatch, **settings):
    """Have all fits of a test made with other settings."""
    monkeypatch.setitem(fitting._fit.__kwdefaults__, "settings", replace(FITTING, **settings))


def bend(points):
    """Bend space smoothly and invertibly near the unit cube."""
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([x + 0.1 * np.sin(2 * y + z), y + 0.08 * np.sin(3 * x * z), z + 0.07 * np.cos(2 * x - y)], axis=-1)


def lattice(n_0, n_1, n_2, powers=(1.4, 1.0, 1.7)):
    """Clustered nodes of the unit cube, shape (n_0, n_1, n_2, 3)."""
    axes = [np.linspace(0, 1, n) ** power for n, power in zip((n_0, n_1, n_2), powers)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def grid_of(*nodes):
    return Grid(tuple(Block(np.ascontiguousarray(x), f"block {b}") for b, x in enumerate(nodes, start=1)))


def bent_block(n=(13, 17, 11)):
    return grid_of(bend(lattice(*n)))


def two_blocks():
    """Two blocks that share a face, the second with its directions permuted and turned round."""
    first = bend(lattice(9, 13, 11))
    second = bend(lattice(15, 13, 11) + [1, 0, 0])
    return grid_of(first, second.transpose(2, 0, 1, 3)[:, ::-1])


def o_grid(n_around=25, n_out=9, n_along=7):
    """An O-grid about a cylinder: the first and the last plane of i are the same."""
    angle = np.linspace(0, 2 * np.pi, n_around)
    angle[-1] = 0
    radius, along = np.linspace(1, 3, n_out) ** 1.3, np.linspace(0, 2, n_along)
    a, r, z = np.meshgrid(angle, radius, along, indexing="ij")
    return grid_of(np.stack([r * np.cos(a), r * np.sin(a) + 0.1 * z, z], axis=-1))


def c_grid(n_wake=9, n_body=25, n_out=11, n_along=5):
    """A C-grid: the wake part of the face jmin lies on itself."""
    wake = np.linspace(4, 1, n_wake)
    angle = np.linspace(0, 2 * np.pi, n_body)[1:-1]
    x = np.concatenate([wake, np.cos(angle), wake[::-1]])
    y = np.concatenate([0 * wake, -0.2 * np.sin(angle), 0 * wake])
    outer_x = np.concatenate([wake, np.cos(angle) * 3, wake[::-1]])
    outer_y = np.concatenate([0 * wake - 3, -3 - 0 * angle, 0 * wake + 3])
    turn = np.linspace(-np.pi / 2, -3 * np.pi / 2, len(angle) + 2)[1:-1]
    outer_x[n_wake:-n_wake], outer_y[n_wake:-n_wake] = 1 + 4 * np.cos(turn), 3 * np.sin(turn)
    t = np.linspace(0, 1, n_out)[None, :, None] ** 1.5
    plane = (1 - t) * np.stack([x, y], axis=-1)[:, None] + t * np.stack([outer_x, outer_y], axis=-1)[:, None]
    nodes = np.empty((len(x), n_out, n_along, 3))
    nodes[..., :2] = plane[:, :, None]
    nodes[..., 2] = np.linspace(0, 1, n_along)
    return grid_of(nodes)


def wedge(n_radius=11, n_around=9, n_along=7):
    """A pie slice: the face imin collapses on the axis."""
    r, a, z = np.meshgrid(
        np.linspace(0, 2, n_radius) ** 1.2, np.linspace(0, 1.5, n_around), np.linspace(0, 3, n_along), indexing="ij"
    )
    return grid_of(np.stack([r * np.cos(a), r * np.sin(a), z + 0.1 * r], axis=-1))


def flat_block():
    """A 2-D block, one node deep."""
    return grid_of(bend(lattice(14, 1, 11)))


def folded_block(n=(41, 8, 6)):
    """A thin layer over a bump that few spans cannot follow: points of the wall pass those above, by least squares."""
    nodes = lattice(*n, powers=(1, 3, 1))
    nodes[..., 1] *= 0.02
    nodes[..., 1] += 0.3 * np.exp(-((nodes[..., 0] - 0.43) ** 2) / 0.0008)
    nodes[..., 0] += 0.2 * nodes[..., 1] * nodes[..., 2]
    return grid_of(nodes)


FOLDING = {"n_control": (9, 5, 4)}
"""Options with which `folded_block` folds by least squares, and falls back on several candidates."""


ALL_SHAPES = {
    f.__name__: f for f in (bent_block, two_blocks, o_grid, c_grid, wedge, flat_block)
}  # by name, for parametrized tests
