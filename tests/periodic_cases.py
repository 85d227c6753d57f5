"""Passages whose sides a motion lays onto each other, cut and turned in many ways, for the tests of tied sides."""

from dataclasses import replace

import numpy as np
from topology_cases import ORIENTATIONS, grid_of, patch

from bspline_mdao.grids.topology.index_space import Window

PITCH = 0.3
"""Angle (rad) of a sector."""


def passage_nodes(shape=(9, 8, 7), motion="rotation", pitch=PITCH, across=(0.0, 1.0), hub=2.0):
    """Nodes of a passage between curved sides, jmin and jmax; all of it, or a part across."""
    i, j, k = np.meshgrid(*(np.linspace(*ends, n) for n, ends in zip(shape, ((0, 1), across, (0, 1)))), indexing="ij")
    if motion == "translation":
        return np.stack([3.0 * i, j + 0.5 * np.sin(2.0 * i), 2.0 * k + 0.1 * i * k], axis=-1)
    turn, radius = pitch * (j + 0.4 * i**2), hub + k + 0.1 * k * np.sin(3.0 * i)
    return np.stack([3.0 * i, radius * np.cos(turn), radius * np.sin(turn)], axis=-1)


def passage(*shape, motion="rotation", wall=4, **options):
    """One block, which meets itself across; its hub, or another face, is a wall."""
    nodes = passage_nodes(shape or (9, 8, 7), motion, **options)
    whole = Window.whole(0, nodes.shape[:3])
    patches = [patch("wall", whole.face(wall), name="hub"), patch("other", whole.face(2), whole.face(3), name="sides")]
    return grid_of(nodes, patches=patches)


def cut_passage(motion="rotation", seed=0, cuts=((5,), (3,))):
    """Two blocks on the one side and two on the other, cut elsewhere and turned at random; walls are at the hub."""
    rng = np.random.default_rng(seed)
    halves = [passage_nodes((9, 4, 7), motion, across=across) for across in ((0.0, 0.4), (0.4, 1.0))]
    blocks, hubs, sides = [], [], []
    for nodes, cut, side in zip(halves, cuts, (2, 3)):
        for lo, hi in zip((0, *cut), (*cut, 8)):
            turn = ORIENTATIONS[rng.integers(48)]
            blocks.append(np.ascontiguousarray(turn.apply(nodes[lo : hi + 1])))
            whole = Window.whole(len(blocks) - 1, blocks[-1].shape[:3])
            hubs.append(whole.face(_face_after(turn, 4)))
            sides.append(whole.face(_face_after(turn, side)))
    return grid_of(*blocks, patches=[patch("wall", *hubs, name="hub"), patch("other", *sides, name="sides")])


def _face_after(turn, face):
    """Number of a face of nodes in ``turn.apply(nodes)``."""
    direction = turn.perm.index(face // 2)
    return 2 * direction + (face % 2 ^ turn.flip[direction])


def untied(topology):
    """A topology without what ties its sides."""
    return replace(topology, periodic=())


def blade_row(turbine, by, n_along=(7, 13, 8), n_across=8, n_up=9):
    """Six blocks around the blade of ``run_scripts/turbine_sector.py``, by amounts of its deformations."""
    along = [turbine.ENDS[0] * np.linspace(1.0, 0.0, n_along[0]) ** 1.5]
    along += [turbine.CHORD * 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, n_along[1])))]
    along += [turbine.CHORD + (turbine.ENDS[1] - turbine.CHORD) * np.linspace(0.0, 1.0, n_along[2]) ** 1.5]
    half = np.expm1(2.0 * np.linspace(0.0, 1.0, n_across)) / np.expm1(2.0)
    half[0] = 1e-300  # both sides of the blade have a sign
    blocks, windows = [], {"blade": [], "hub": [], "casing": [], "inlet": [], "outlet": [], "sides": []}
    for part, x in enumerate(along):
        for side, across in enumerate((-half[::-1], half)):
            places = np.stack(np.meshgrid(x, across, np.linspace(0.0, 1.0, n_up), indexing="ij"), axis=-1)
            whole = Window.whole(len(blocks), places.shape[:3])
            blocks.append(turbine.shape(places.reshape(-1, 3), turbine.NONE | by).reshape(places.shape))
            faces = {"hub": 4, "casing": 5, "sides": 2 + side}
            faces |= {0: {"inlet": 0}, 1: {"blade": 3 - side}, 2: {"outlet": 1}}[part]
            for name, face in faces.items():
                windows[name].append(whole.face(face))
    kinds = {"inlet": "farfield", "outlet": "farfield", "sides": "other"}
    return grid_of(*blocks, patches=[patch(kinds.get(name, "wall"), *of, name=name) for name, of in windows.items()])
