"""Grids with outer walls that are not planes, on which nodes of a wall's neighbours slide."""

import numpy as np
from topology_cases import grid_of, patch

from bspline_mdao import fit_grid
from bspline_mdao.core.generators.stretching import stretch_from
from bspline_mdao.grids.topology.index_space import Window

SIDES = {"inlet": 0, "outlet": 1, "blade": 2, "far": 3, "hub": 4, "casing": 5}
KINDS = {"blade": "wall", "hub": "other", "casing": "other", "inlet": "other", "outlet": "other", "far": "farfield"}
SHIFT = np.array([3.0, -2.0, 1.0])


def passage_grid(shape=(13, 9, 11), contour=None, turn=None, n_blocks=1, off_wall=None, **kinds):
    """A passage beside a blade, between a hub and a casing about x, whole or cut in two along x, viscous or not."""
    contour = contour or (lambda x: 2.0 + 0.0 * x)
    n_along, n_around, n_off = shape
    around, part = np.linspace(0.0, 1.0, n_around) ** 1.4, np.linspace(0.0, 1.0, n_off)
    if off_wall is not None:
        half = 0.5 * stretch_from(n_off // 2 + 1, 2.0 * off_wall)
        around, part = stretch_from(n_around, off_wall), np.concatenate([half, 1.0 - half[-2::-1]])
    x, angle, part = np.meshgrid(np.linspace(0.0, 1.5, n_along) ** 1.1, 0.05 + 0.9 * around, part, indexing="ij")
    angle = angle + 0.08 * np.sin(np.pi * x / 1.5) * (0.95 - angle)  # the blade is cambered
    r = 1.0 + part * (contour(x) - 1.0)
    nodes = np.stack([x, r * np.cos(angle), r * np.sin(angle)], axis=-1)
    nodes = nodes if turn is None else nodes @ turn.T + SHIFT
    cut = n_along // 2
    blocks = [nodes] if n_blocks == 1 else [nodes[: cut + 1], nodes[cut:]]
    wholes = [Window.whole(number, block.shape[:3]) for number, block in enumerate(blocks)]
    patches = []
    for name, side in SIDES.items():
        on = {"inlet": wholes[:1], "outlet": wholes[-1:]}.get(name, wholes)
        patches.append(patch({**KINDS, **kinds}[name], *(whole.face(side) for whole in on), name=name))
    return grid_of(*blocks, patches=patches)


def passage(n_control=(6, 5, 6), **options):
    """The same, fitted."""
    return fit_grid(passage_grid(**options), n_control=n_control)


def rows_of(model, name):
    """Rows of the nodes of a patch."""
    numbers = model.topology.layout.numbers
    windows = [face.window for face in model.topology.boundary if face.patch == name]
    return np.unique(np.concatenate([numbers[w.block][w.slices].ravel() for w in windows]))


def surface_of(mesh, name):
    """The surface that a patch slides on."""
    return next(slide.surface for slide in mesh.slides if slide.what == f"patch '{name}'")


def lean(mesh, amount, turn=None):
    """Surface points of a mesh turned about x, more where they are farther from it, and not alike along it."""
    points = mesh.points[mesh.surface_ids]
    x, y, z = (points if turn is None else (points - SHIFT) @ turn).T
    angle = amount * np.sin(2.0 * x) * (y * y + z * z)
    c, s = np.cos(angle), np.sin(angle)
    leant = np.column_stack([x, c * y - s * z, s * y + c * z])
    return leant if turn is None else leant @ turn.T + SHIFT


def wing_on_body_grid(shape=(9, 9, 11), off_wall=2e-3):
    """A wing on one side of a plane that holds the axis of a round body, three blocks in a row, viscous at both."""
    n_along, n_around, n_off = shape
    around, part = 0.9 * stretch_from(n_around, off_wall), stretch_from(n_off, off_wall)
    blocks = []
    for number in range(3):
        x = number + np.linspace(0.0, 1.0, n_along)
        x, angle, r = np.meshgrid(x, around, 1.0 + 2.0 * part, indexing="ij")
        bump = np.sin(np.pi * (x - 1.0)) ** 2 if number == 1 else 0.0 * x
        angle = angle + 0.06 * bump * (0.9 - angle)
        blocks.append(np.stack([x, r * np.cos(angle), r * np.sin(angle)], axis=-1))
    wholes = [Window.whole(number, block.shape[:3]) for number, block in enumerate(blocks)]
    patches = [patch("wall", wholes[1].face(2), name="wing"), patch("wall", *(w.face(4) for w in wholes), name="body")]
    patches.append(patch("symmetry", wholes[0].face(2), wholes[2].face(2), name="beside"))
    ends = (wholes[0].face(0), wholes[2].face(1), *(w.face(3) for w in wholes), *(w.face(5) for w in wholes))
    return grid_of(*blocks, patches=[*patches, patch("farfield", *ends, name="far")])


def wing_and_body_grid(shape=(11, 9, 11), off_wall=2e-3):
    """A wing on a round body about x, six blocks, three on either side of the wing, viscous at both."""
    n_along, n_around, n_off = shape
    around, part = 0.9 * stretch_from(n_around, off_wall), stretch_from(n_off, off_wall)
    blocks, patches = [], []
    for side, number in np.ndindex(2, 3):
        x = number + (1.0 - np.cos(np.pi * np.linspace(0.0, 1.0, n_along))) / 2.0
        x, angle, r = np.meshgrid(x, around, 1.0 + 2.0 * part, indexing="ij")
        section = np.maximum(x - 1.0, 0.0) * np.maximum(2.0 - x, 0.0)
        angle = angle + 0.3 * section / r * (0.9 - angle)
        angle = (1.0, -1.0)[side] * angle
        blocks.append(np.stack([x, r * np.sin(angle), r * np.cos(angle)], axis=-1))
    wholes = [Window.whole(number, block.shape[:3]) for number, block in enumerate(blocks)]
    patches = [patch("wall", wholes[n].face(2), name=name) for n, name in ((1, "wing upper"), (4, "wing lower"))]
    patches.append(patch("wall", *(w.face(4) for w in wholes), name="body"))
    ends = [w.face(side) for n, w in enumerate(wholes) for side in {0: (0, 3, 5), 1: (3, 5), 2: (1, 3, 5)}[n % 3]]
    return grid_of(*blocks, patches=[*patches, patch("farfield", *ends, name="far")])
