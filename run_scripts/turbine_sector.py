"""A turbine passage with periodic sides.

One passage of a blade row, between two sides that a rotation maps onto each other, gets another blade and hub. The mesh
of hexahedra is one sector of a wheel, from the hub to the casing, around one blade; its sides follow the camber line. A
lattice around the axis moves it: the blade is twisted, leaned and made thicker, the hub rises between the blades, the
casing sinks, and all of these at once. Hub and casing end on both sides, which move in the same way, so nodes on them
still coincide when the sector is turned by its angle. It takes ten seconds, and half a minute with ``--paper``. The
output is gaps between the sides, inverted cells, smallest volumes and heights of the first nodes relative to the
baseline, a check of the derivatives, and a picture.
"""

from __future__ import annotations

import numpy as np

from bspline_mdao.meshes import LatticeSettings, MeshModel, MixedMesh
from bspline_mdao.plotting import BLUE, GRAY, figure
from bspline_mdao.scripts import pick_size, run

SIZES = {"quick": ((5, 11, 6), 7, 9), "default": ((9, 21, 11), 13, 17), "paper": ((17, 41, 21), 25, 33)}
"""Nodes ahead of the blade, along it and behind it, from the blade to a side, and from the hub to the casing."""

N_BLADES, HUB, CASING, CHORD, ENDS = 24, 1.0, 1.4, 0.3, (-0.4, 0.8)
"""Blades of the wheel, radii, length of the blade along the axis, and where the mesh ends (m)."""

TURNING, THICKNESS = np.radians(50.0), 0.1
"""Angle by which the camber line turns (rad), and the thickness of the blade by its length along the axis."""

PITCH, MIDDLE = 2.0 * np.pi / N_BLADES, 0.5 * (HUB + CASING)
"""Angle of the sector (rad), and the radius in the middle (m)."""

SPANS = 20
"""Of the lattice along the walls: hub and casing are four times as long as the blade."""

NONE = {"twist": 0.0, "lean": 0.0, "thicker": 0.0, "hub": 0.0, "casing": 0.0}
MOVES = {
    "twist": {"twist": np.radians(6.0)},  # at the casing, in proportion to the height (rad)
    "lean": {"lean": np.radians(1.0)},  # at the casing (rad)
    "thicker": {"thicker": 0.5},  # by the thickness
    "hub": {"hub": 0.012},  # how far it rises in the middle between two blades, and sinks at them (m)
    "casing": {"casing": -0.02},  # how far it sinks (m)
}
MOVES["all"] = {name: amount for move in MOVES.values() for name, amount in move.items()}

LOW, HIGH = slice(None, -1), slice(1, None)
RING = (LOW, LOW), (LOW, HIGH), (HIGH, HIGH), (HIGH, LOW)
"""Corners of a cell around its third direction."""


def main(paper: bool = False, figures=None, quick: bool = False) -> dict:
    """Make the mesh and move it.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``turbine_sector.png``.

    Returns
    -------
    dict
        ``n_points`` and ``n_cells`` of the mesh, the ``gap`` of its sides (m), the ``lattice``; and by move ``gap``
        (m), ``n_inverted``, ``smallest_ratio`` of volumes by those before, ``heights``, the 1st, 50th and 99th
        percentile by those before, ``displacement`` (m), and ``products``, by how much forward and reverse products
        differ.
    """
    mesh, places = make_mesh(*pick_size(SIZES, paper, quick))
    kinds = dict.fromkeys(("blade", "hub", "casing"), "wall") | {"inlet": "farfield", "outlet": "farfield"}
    model = MeshModel.of(mesh, kinds | {"side_1": "periodic", "side_2": "periodic"}, LatticeSettings(spans=SPANS))
    (sides,) = model.periodic
    states = {name: move(model, places, NONE | amounts) for name, amounts in MOVES.items()}
    if figures:
        draw(figures, model, places, {name: state.nodes for name, (state, _) in states.items()})
    numbers = {"n_points": mesh.n_points, "n_cells": mesh.n_cells, "lattice": list(model.lattice.shape)}
    return numbers | {"gap": sides.gap(mesh.points)} | {
        name: judge(model, state, forward) for name, (state, forward) in states.items()
    }  # fmt: skip


def make_mesh(n_along: tuple[int, int, int], n_across: int, n_up: int) -> tuple[MixedMesh, np.ndarray]:
    """Make the sector, and the places of its nodes: along the axis (m), from -1 to 1 across, from 0 to 1 upwards."""
    ahead, on, behind = n_along
    x = np.concatenate([
        ENDS[0] * np.linspace(1.0, 0.0, ahead)[:-1] ** 1.5,
        CHORD * 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, on))),
        CHORD + (ENDS[1] - CHORD) * np.linspace(0.0, 1.0, behind)[1:] ** 1.5,
    ])  # fmt: skip
    half = np.expm1(3.0 * np.linspace(0.0, 1.0, n_across)) / np.expm1(3.0)  # narrow at the blade
    up = 0.5 * (1.0 + np.tanh(2.0 * np.linspace(-1.0, 1.0, n_up)) / np.tanh(2.0))
    places = np.stack(np.meshgrid(x, np.concatenate([-half[::-1], half]), up, indexing="ij"), axis=-1)
    ids = np.arange(places[..., 0].size).reshape(places.shape[:3])
    first, last = ahead - 1, ahead + on - 2  # the nose and the tail
    off = np.r_[: first + 1, last : len(x)]
    ids[off, n_across] = ids[off, n_across - 1]  # both sides of the blade are one there
    cells = np.stack([ids[i, j, k] for k in (LOW, HIGH) for i, j in RING], axis=-1)
    cells = np.delete(cells, n_across - 1, axis=1)
    blade = ids[first : last + 1, n_across - 1 : n_across + 1]
    nets = {"hub": ids[:, :, 0], "casing": ids[:, :, -1], "inlet": ids[0], "outlet": ids[-1]}
    nets |= {"side_1": ids[:, 0], "side_2": ids[:, -1], "lower": blade[:, 0], "upper": blade[:, 1]}
    markers = {name: np.stack([net[i, j] for i, j in RING], axis=-1) for name, net in nets.items()}
    for name, axis in (("hub", 1), ("casing", 1), ("inlet", 0), ("outlet", 0)):
        markers[name] = np.delete(markers[name], n_across - 1, axis=axis)  # no face is inside the blade
    markers = {name: faces.reshape(-1, 4) for name, faces in markers.items()}
    markers["blade"] = np.concatenate([markers.pop("lower"), markers.pop("upper")])
    used, cells = np.unique(cells, return_inverse=True)
    places = places.reshape(-1, 3)[used]
    numbered = {name: np.searchsorted(used, faces) for name, faces in markers.items()}
    return MixedMesh(shape(places, NONE), {"hexahedron": cells.reshape(-1, 8)}, numbered, source="sector"), places


def shape(places: np.ndarray, by: dict[str, complex]) -> np.ndarray:
    """Nodes at places by the amounts of deformations (m), shape (n, 3): they may be complex."""
    x, across, up = places.T
    part, along = np.clip(x / CHORD, 0.0, 1.0), np.maximum(x, 0.0)
    camber = -np.tan(TURNING) / MIDDLE * np.where(x > CHORD, x - 0.5 * CHORD, 0.5 * along**2 / CHORD)
    beside = 1.0 - np.abs(across)
    thickness = 2.0 * THICKNESS * CHORD * part * (1.0 - part) * (1.0 + by["thicker"])
    angle = camber + 0.5 * PITCH * across + np.sign(across) * beside * thickness / MIDDLE
    to_end = np.where(x < 0.0, x / ENDS[0], np.maximum(x - CHORD, 0.0) / (ENDS[1] - CHORD))
    near = beside**2 * (3.0 - 2.0 * beside) * (1.0 - to_end) ** 2 * (1.0 + 2.0 * to_end)  # 1 on the blade, 0 at sides
    turn, middle = by["twist"] * up * near, (0.5 * CHORD, -0.125 * np.tan(TURNING) * CHORD)
    ahead, around = x - middle[0], MIDDLE * angle - middle[1]
    x = middle[0] + np.cos(turn) * ahead - np.sin(turn) * around
    angle = (middle[1] + np.sin(turn) * ahead + np.cos(turn) * around) / MIDDLE + by["lean"] * up * near
    inside = np.sin(np.pi * (x - ENDS[0]) / (ENDS[1] - ENDS[0])) ** 2
    hub, casing = HUB - by["hub"] * np.cos(np.pi * across) * inside, CASING + by["casing"] * inside
    radius = hub + up * (casing - hub)
    return np.stack([x, radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def move(model: MeshModel, places: np.ndarray, by: dict[str, float]):
    """Move the mesh behind its walls; also the change of its nodes with all amounts in proportion."""
    walls = places[model.wall_rows]
    movement = model.mover.move(model.control_points, shape(walls, by))
    state = model.node_map.at(movement.points)
    change = shape(walls, {name: amount * (1.0 + 1e-40j) for name, amount in by.items()}).imag / 1e-40
    return state, (movement, change)


def judge(model: MeshModel, state, forward) -> dict:
    """Measure a mesh that was moved, see `main`."""
    mesh, (movement, change), (sides,) = model.mesh, forward, model.periodic
    walls, after = model.following_walls, mesh.quality(state.nodes)
    bar = np.random.default_rng(0).normal(size=state.nodes.shape)
    there = np.vdot(bar, state.jvp(movement.jvp(np.zeros_like(model.control_points), change)))
    back = np.vdot(movement.vjp(state.vjp(bar)["control_points"])[1], change)
    return {
        "gap": sides.gap(state.nodes),
        "n_inverted": int(after.is_inverted.sum()),
        "smallest_ratio": float((after.volumes / mesh.quality().volumes).min()),
        "heights": np.percentile(walls.heights(state.nodes) / walls.heights(mesh.points), [1.0, 50.0, 99.0]).tolist(),
        "displacement": float(np.linalg.norm(state.nodes - mesh.points, axis=1).max()),
        "products": abs(there - back) / abs(there),
    }


def draw(folder, model: MeshModel, places: np.ndarray, states: dict) -> None:
    """Draw two passages at the casing, before and after, and hub and casing."""
    states = {"baseline": model.mesh.points} | states
    (sides,) = model.periodic
    with figure(folder, "turbine_sector", size=(12.0, 4.4)) as canvas:
        *tops, last = canvas.subplots(1, 4, width_ratios=(1.0, 1.0, 1.0, 1.2))
        faces = model.mesh.markers["casing"]
        for axes, name in zip(tops, ("baseline", "twist", "all")):
            for points, color in ((states[name], BLUE), (sides.motion.move(states[name]), GRAY)):
                x, radius = points[:, 0], np.hypot(points[:, 1], points[:, 2])
                rings = np.stack([x, radius * np.arctan2(points[:, 2], points[:, 1])], axis=1)[
                    faces[:, [0, 1, 2, 3, 0]]
                ]
                axes.plot(*np.moveaxis(rings, 2, 0).swapaxes(1, 2), color=color, linewidth=0.3)
            axes.set(title=f"casing, {name}", aspect="equal", xlabel="$x$ (m)", ylabel=r"$r \theta$ (m)")
        for name, color in (("baseline", GRAY), ("all", BLUE)):
            for up, across in ((0.0, 1.0), (0.0, 0.0), (1.0, 0.0)):
                rows = np.flatnonzero((places[:, 2] == up) & (np.abs(places[:, 1] - across) < 1e-12))
                x, y, z = states[name][rows[np.argsort(places[rows, 0])]].T
                last.plot(x, np.hypot(y, z), color=color, label=name if up else None)
        last.set(title="hub at the blade and at a side, casing", xlabel="$x$ (m)", ylabel="$r$ (m)")
        last.legend()


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/turbine_sector.png'
