"""Bodies that are close to each other: smallest areas or volumes of cells as they move apart.

``python benchmarks/core/bench_close_bodies.py [--json FILE]``, with Gmsh.

A flap of 0.1 chords is 0.01 chords below the end of a main element; of three elements, slat and flap are 0.015 and
0.012 away. Layers at their walls begin with 1e-5 chords. A store of 0.6 chords hangs 0.05 below a wing, in
tetrahedra. Each move is made with spans by body and gap, and with one width.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

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
    import gmsh

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


def make_store(path: Path) -> None:
    """Write tetrahedra around half a wing and an ellipsoid below it."""
    import gmsh

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    occ, field = gmsh.model.occ, gmsh.model.mesh.field

    def section(start: float, chord: float, z: float) -> int:
        outline = [start, 0.0] + airfoil(chord, 0.12, 16)
        points = [occ.addPoint(x, y, z) for x, y in outline]
        return occ.addWire([occ.addSpline(points[:16]), occ.addSpline([*points[15:], points[0]])])

    wing = occ.addThruSections([section(0.0, 1.0, 0.0), section(0.6, 0.6, 3.0)])[:1]
    store, middle = [(3, occ.addSphere(0.0, 0.0, 0.0, 1.0))], np.array([0.6, -0.145, 1.2])
    occ.rotate(store, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, np.pi / 2.0)  # its poles are nose and tail
    occ.dilate(store, 0.0, 0.0, 0.0, 0.3, 0.04, 0.04)
    occ.translate(store, *middle)
    fluid, _ = occ.cut([(3, occ.addBox(-15.0, -15.0, 0.0, 30.0, 30.0, 15.0))], wing + store)
    occ.synchronize()
    groups: dict[str, list[int]] = {"symmetry": [], "farfield": [], "store": [], "wing": []}
    for _, face in gmsh.model.getEntities(2):
        at = np.array(occ.getCenterOfMass(2, face))
        which = (at[2] < 1e-6, np.abs(at).max() > 5.0, np.linalg.norm(at - middle) < 0.02, True)
        groups[list(groups)[which.index(True)]].append(face)
    sizes = []
    for name, size in (("wing", 0.06), ("store", 0.021)):
        distance, growing = field.add("Distance"), field.add("MathEval")
        field.setNumbers(distance, "SurfacesList", groups[name])
        field.setNumber(distance, "Sampling", 100)
        field.setString(growing, "F", f"{size} + 0.3 * F{distance}")
        sizes.append(growing)
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", sizes)
    field.setAsBackgroundMesh(least)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    for name, faces in groups.items():
        gmsh.model.addPhysicalGroup(2, faces, name=name)
    gmsh.model.addPhysicalGroup(3, [volume for _, volume in fluid], name="fluid")
    gmsh.model.mesh.generate(3)
    gmsh.write(str(path))
    gmsh.finalize()


def moves_of_store(model: MeshModel) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names of moves of the store, and where they put the nodes of walls."""
    walls = model.mesh.points[model.wall_rows]
    store = np.searchsorted(model.wall_rows, np.unique((model.mesh.markers or {})["store"]))
    for name, shift in (
        ("0.05 down", (0.0, -0.05, 0.0)),
        ("0.2 down", (0.0, -0.2, 0.0)),
        ("0.02 up", (0.0, 0.02, 0.0)),
    ):
        moved = walls.copy()
        moved[store] += shift
        yield f"store goes {name}", moved
    for degrees in (5.0, 15.0):
        moved = walls.copy()
        moved[store, :2] = turned(walls[store, :2], degrees, walls[store, :2].mean(axis=0))
        yield f"store turns by {degrees:g} degrees", moved
    moved = walls.copy()
    moved[store, 0] += 0.1
    yield "store goes 0.1 aft", moved


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
    asked = moves_of_store if "store" in model.kinds else moves
    for move, walls in asked(model):
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
    cases = [(name, partial(make_mesh, bodies=bodies)) for name, bodies in sections()]
    for name, make in [*cases, ("store", make_store)]:
        with tempfile.TemporaryDirectory() as folder:
            make(Path(folder, "mesh.su2"))
            model = fit_mesh(Path(folder, "mesh.su2"))
        width = float(np.ptp(model.box.walls, axis=0)[model.box.sides].max()) / model.settings.spans
        for text, each in (("by body", model), ("one width", model.with_settings(LatticeSettings(spacing=width)))):
            results.append(judged(f"{name}, {text}", each))
            print(f"{results[-1]['mesh']}: lattice {results[-1]['lattice']}")
            for move, numbers in results[-1]["moves"].items():
                print(
                    f"    {move:26s} inverted {numbers['inverted']}, smallest by that before "
                    f"{numbers['area']:.3f}, missed by the lattice {numbers['missed']:.1e}"
                )
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
