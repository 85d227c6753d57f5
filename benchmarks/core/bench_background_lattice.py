"""Meshes without structure that move by a lattice in the background: CPU seconds, inverted cells, heights at walls.

``python benchmarks/core/bench_background_lattice.py [--scale 1 1.5 2] [--spacings 1 0.7] [--json FILE]``

The mesh is the H-H grid about the ONERA M6 wing with a boundary layer, at growing sizes, its cells cut into wedges.
With ``BSPLINE_MDAO_GRIDS``, it is pyHyp's M6 as well. ``bytes`` are those of the map and of the factors for each node,
and ``products`` is by how much those of forward and reverse differ.
"""

from __future__ import annotations

import argparse
import json
import os
from functools import partial
from pathlib import Path

import numpy as np
from bench_ride import SHAPE, SPACING, SPLITS, joined, quads_of, timed, with_halves

from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.io.files import read_grid
from bspline_mdao.grids.io.patch_guess import with_guessed_patches
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.meshes import MixedMesh

MOVES = ("twist=5deg", "twist=20deg", "bend=30deg@0.5,length=0.5", "bend=60deg@0.5,length=0.5", "sweep=15deg")


def wedges_of(grid) -> tuple[MixedMesh, dict[str, str]]:
    """Cut the cells of a grid into wedges; kinds of the markers."""
    topology, (points, numbers, hexahedra) = find_topology(grid), joined(grid)
    corners = hexahedra[:, SPLITS["wedge"]].reshape(-1, 6)
    bare, markers, kinds = MixedMesh(points, {"wedge": corners}), {}, {}
    for name in dict.fromkeys(str(face.patch) for face in topology.boundary):
        faces = [face for face in topology.boundary if str(face.patch) == name]
        quads = quads_of(grid, topology, numbers, faces)
        markers[name], kinds[name] = bare.into_fluid(with_halves(quads))[:, ::-1], str(faces[0].kind)
    return MixedMesh(points, {"wedge": corners}, markers), kinds


def judged(name: str, mesh: MixedMesh, kinds: dict[str, str], part: float) -> dict:
    """Lay a lattice around a mesh, with a part of the default spacing, and move it."""

    def made() -> MeshModel:
        model = MeshModel.of(mesh, kinds)
        if part != 1.0:
            model = model.with_settings(LatticeSettings(spacing=part * model.lattice.spacing))
        model.node_map  # noqa: B018 - made at first use
        return model

    seconds, model = timed(made)
    baseline = model.control_points, mesh.points[model.wall_rows]
    factor_seconds, _ = timed(lambda: model.mover.move(*baseline))
    walls, moves = model.node_map.embedded.walls, {}
    for text in MOVES:
        asked = model.deformed(parse_deformation(text, model, model.moving_mesh))
        move_seconds, movement = timed(partial(model.mover.move, model.control_points, asked))
        map_seconds, state = timed(partial(model.node_map.at, movement.points))
        ratios = walls.heights(state.nodes) / walls.heights(mesh.points)
        before, after = mesh.quality(), mesh.quality(state.nodes)
        moves[text] = {
            "inverted": int((after.is_inverted & ~before.is_inverted).sum()),
            "heights": np.quantile(ratios, [0.01, 0.99]).round(4).tolist(),
            "volume": float((after.volumes / before.volumes).min()),
            "seconds": move_seconds + map_seconds,
        }
    rng = np.random.default_rng(0)
    bar, direction = rng.normal(size=state.nodes.shape), rng.normal(size=asked.shape)
    nothing = np.zeros_like(model.control_points)
    forward_seconds, change = timed(lambda: state.jvp(movement.jvp(nothing, direction)))
    reverse_seconds, bars = timed(lambda: movement.vjp(state.vjp(bar)["control_points"])[1])
    forward, reverse = np.vdot(bar, change), np.vdot(bars, direction)
    n_bytes = sum(factor.factor.n_bytes for factor in model.mover._factors.values())
    n_bytes += model.node_map.embedded.evaluator.bytes_per_node * model.n_nodes + walls.following.layer.n_bytes
    return {
        "mesh": name,
        "nodes": mesh.n_points,
        "cells": mesh.n_cells,
        "lattice": list(model.lattice.shape),
        "fit": seconds,
        "factor": factor_seconds,
        "forward": forward_seconds,
        "reverse": reverse_seconds,
        "products": float(abs(forward - reverse) / np.linalg.norm(bar) / np.linalg.norm(change)),
        "bytes": n_bytes / mesh.n_points,
        "moves": moves,
    }


def shown(found: dict) -> None:
    """Print what was found of a mesh."""
    print(
        f"{found['mesh']}: {found['nodes']:,} nodes, {found['cells']:,} cells, lattice {found['lattice']}; CPU s: "
        f"map {found['fit']:.2f}, factors {found['factor']:.2f}, forward {found['forward']:.3f}, reverse "
        f"{found['reverse']:.3f}; products {found['products']:.1e}; {found['bytes']:.0f} bytes a node"
    )
    for text, move in found["moves"].items():
        low, high = move["heights"]
        print(
            f"    {text:28s} {move['seconds']:.3f} s, inverted {move['inverted']}, heights {low} to {high}, "
            f"smallest volume by that before {move['volume']:.3f}"
        )


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scale", type=float, nargs="*", default=[1.0, 1.5])
    parser.add_argument("--spacings", type=float, nargs="*", default=[1.0])
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    meshes = {
        f"H-H, {scale:g}": wedges_of(onera_m6_grid(tuple(round(scale * n) for n in SHAPE), SPACING))
        for scale in options.scale
    }
    folder = os.environ.get("BSPLINE_MDAO_GRIDS")
    if folder:
        meshes["pyHyp's M6"] = wedges_of(with_guessed_patches(read_grid(Path(folder, "pyhyp_m6_9blocks.xyz"))))
    results = []
    for name, (mesh, kinds) in meshes.items():
        for part in options.spacings:
            results.append(judged(name if part == 1.0 else f"{name}, spacing {part:g}", mesh, kinds, part))
            shown(results[-1])
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
