"""Sections of several bodies that are close to each other: smallest areas of cells as the bodies move apart.

``python benchmarks/core/bench_close_bodies.py [--json FILE]``, with Gmsh.

A flap of 0.1 chords is 0.01 chords below the end of a main element; of three elements, slat and flap are 0.015 and
0.012 away. Layers at walls begin with 1e-5 chords. Each move is made with spans by body and gap, and with one width.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import gmsh
import numpy as np
from scipy.spatial import cKDTree

from bspline_mdao.meshes import LatticeSettings, MeshModel, fit_mesh

GROWTH, FIRST, LAYER, SIZE, FAR = 0.15, 1e-5, 3e-3, 4e-3, 20.0
"""Of edges with the distance from walls, the first height, the thickness of the layer, edges on walls, and the end."""


def airfoil(chord: float, thickness: float, n: int, camber: float = 0.0) -> np.ndarray:
    """Points of a section with a closed trailing edge, from there over the upper side."""
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, n)))
    y = 5.0 * thickness * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    line = 4.0 * camber * x * (1.0 - x)
    return chord * np.concatenate([np.stack([x, line + y], 1)[::-1], np.stack([x, line - y], 1)[1:-1]])


def turned(points: np.ndarray, degrees: float, about: np.ndarray) -> np.ndarray:
    """Turn points, nose up."""
    a = np.radians(-degrees)
    return (points - about) @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) + about


def placed(main: np.ndarray, part: np.ndarray, gap: float, direction: tuple[float, float]) -> np.ndarray:
    """Slide a body along a direction until it is a gap away from another."""
    along = np.array(direction) / np.linalg.norm(direction)
    parts = np.linspace(0.0, 1.0, 20, endpoint=False)[:, None, None]
    dense = [(each + (np.roll(each, -1, 0) - each) * parts).reshape(-1, 2) for each in (main, part)]
    tree, low, high = cKDTree(dense[0]), 0.0, 2.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if tree.query(dense[1] + middle * along)[0].min() < gap else (low, middle)
    return part + high * along


def sections() -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """Yield names and bodies."""
    main, origin = airfoil(1.0, 0.12, 80), np.zeros(2)
    flap = turned(airfoil(0.1, 0.12, 40), 20.0, origin) + [0.97, 0.0]
    yield "two", {"main": main, "flap": placed(main, flap, 0.01, (0.3, -1.0))}
    slat = turned(airfoil(0.15, 0.1, 40, 0.05), -25.0, origin) + [-0.13, -0.07]
    flap = turned(airfoil(0.3, 0.12, 50, 0.02), 30.0, origin) + [0.96, 0.0]
    slat, flap = placed(main, slat, 0.015, (-1.0, 0.1)), placed(main, flap, 0.012, (0.3, -1.0))
    yield "three", {"slat": slat, "main": main, "flap": flap}


def make_mesh(path: Path, bodies: dict[str, np.ndarray]) -> None:
    """Write triangles around bodies, with layers of quads at them."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    geo, field = gmsh.model.geo, gmsh.model.mesh.field
    angle = 2.0 * np.pi * np.arange(32) / 32
    circle = [0.5, 0.0] + FAR * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    loops, groups, tips = [], {}, []
    for name, outline in {"farfield": circle, **bodies}.items():
        points = [geo.addPoint(x, y, 0.0) for x, y in outline]
        groups[name] = [geo.addLine(a, b) for a, b in zip(points, points[1:] + points[:1])]
        loops.append(geo.addCurveLoop(groups[name]))
        tips += [points[0]] * (name != "farfield")
    fluid = geo.addPlaneSurface(loops)
    geo.synchronize()
    walls = [line for name in bodies for line in groups[name]]
    distance, growing, layer = field.add("Distance"), field.add("MathEval"), field.add("BoundaryLayer")
    field.setNumbers(distance, "CurvesList", walls)
    field.setNumber(distance, "Sampling", 30)
    field.setString(growing, "F", f"{SIZE} + {GROWTH} * F{distance}")
    field.setAsBackgroundMesh(growing)
    field.setNumbers(layer, "CurvesList", walls)
    field.setNumbers(layer, "FanPointsList", tips)
    for name, value in (("Size", FIRST), ("Ratio", 1.25), ("Thickness", LAYER), ("Quads", 1)):
        field.setNumber(layer, name, value)
    field.setAsBoundaryLayer(layer)
    for name, value in (("MeshSizeExtendFromBoundary", 0), ("MeshSizeFromPoints", 0), ("BoundaryLayerFanElements", 7)):
        gmsh.option.setNumber(f"Mesh.{name}", value)
    for name, lines in groups.items():
        gmsh.model.addPhysicalGroup(1, lines, name=name)
    gmsh.model.addPhysicalGroup(2, [fluid], name="fluid")
    gmsh.model.mesh.generate(2)
    gmsh.write(str(path))
    gmsh.finalize()


def moves(model: MeshModel) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names of moves, and where they put the nodes of walls."""
    walls = model.mesh.points[model.wall_rows]
    flap = np.searchsorted(model.wall_rows, np.unique((model.mesh.markers or {})["flap"]))
    for degrees in (5.0, 10.0):
        moved = walls.copy()
        moved[flap, :2] = turned(walls[flap, :2], degrees, walls[flap, :2].min(axis=0))
        yield f"flap turns by {degrees:g} degrees", moved
    for name, shift in (("down", (0.0, -0.02)), ("up", (0.0, 0.003)), ("aft", (0.02, 0.0))):
        moved = walls.copy()
        moved[flap, :2] += shift
        yield f"flap goes {name}", moved
    moved = walls.copy()
    moved[:, :2] = turned(walls[:, :2], 20.0, np.array([0.25, 0.0]))
    yield "all turn by 20 degrees", moved


def judged(name: str, model: MeshModel) -> dict:
    """Make all moves."""
    before, found = model.mesh.quality(), {}
    for move, walls in moves(model):
        movement = model.mover.move(model.control_points, walls)
        after = model.mesh.quality(model.node_map.at(movement.points).nodes)
        missed = np.linalg.norm(model.mover.missed(walls - model.mesh.points[model.wall_rows]), axis=1).max()
        found[move] = {
            "inverted": int((after.is_inverted & ~before.is_inverted).sum()),
            "area": float((after.volumes / before.volumes).min()),
            "missed": float(missed),
        }
    return {"mesh": name, "lattice": list(model.lattice.shape), "moves": found}


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path)
    options, results = parser.parse_args(), []
    for name, bodies in sections():
        with tempfile.TemporaryDirectory() as folder:
            make_mesh(Path(folder, "mesh.su2"), bodies)
            model = fit_mesh(Path(folder, "mesh.su2"))
        width = float(np.ptp(model.mesh.points[model.wall_rows], axis=0)[:2].max()) / model.settings.spans
        for text, each in (("by body", model), ("one width", model.with_settings(LatticeSettings(spacing=width)))):
            results.append(judged(f"{name}, {text}", each))
            print(f"{results[-1]['mesh']}: lattice {results[-1]['lattice']}")
            for move, numbers in results[-1]["moves"].items():
                print(
                    f"    {move:26s} inverted {numbers['inverted']}, smallest area by that before "
                    f"{numbers['area']:.3f}, missed by the lattice {numbers['missed']:.1e}"
                )
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
