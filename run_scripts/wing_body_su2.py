"""Wing and fuselage in a tetrahedral mesh.

A wing with a fuselage in tetrahedra, moved and optimised from its SU2 file only. Gmsh makes the mesh of half the
aircraft. From then on only the file is used: its markers say what is a wall and where the plane of symmetry is. The
wing is twisted, bent and swept, and the fuselage widened. Then the chords and sections of the wing are optimised for
the largest volume at the planform area and the wetted area of the baseline, with no section much thinner or thicker
than it was. It takes half a minute, and four minutes with ``--paper``. The output is inverted cells and smallest
volumes relative to the baseline, the optimum, a check of the totals, pictures, and SU2 files.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.drivers import disagreement, nlopt, recorded, scipy_slsqp
from bspline_mdao.meshes import MeshModel, MixedMesh, marker_kinds
from bspline_mdao.plotting import BLUE, GRAY, Camera, draw_history, figure
from bspline_mdao.scripts import pick_size, run
from bspline_mdao.testing import check_totals, perturb_design

SIZES = {"quick": (0.3, 1e-4), "default": (0.12, 1e-6), "paper": (0.07, 1e-6)}
"""Length of edges on the walls (m), and the tolerance of the volume (m^3)."""

SPAN, CHORDS, TIP_AT = 3.5, np.array([1.6, 0.7]), 1.6
"""Half span, chords in the plane of symmetry and at the tip, and where the tip begins along the stream (m)."""

RADIUS, LENGTH, MIDDLE = 0.5, 8.0, 1.0
"""Of the fuselage, which is an ellipsoid, its length, and where its middle is along the stream (m)."""

FAR = 15.0
"""Where the mesh ends, from the origin (m)."""

MOVES, WIDER = ("twist=10deg", "twist=30deg", "bend=60deg@0.5", "sweep=15deg"), 1.3
"""Deformations of the wing, as the command ``move`` takes them, and the factor on the width of the fuselage."""

CHORD, THICKNESS, HEIGHT, WORST = (0.7, 1.3), (0.8, 1.25), 0.06, 0.4
"""Bounds of chords and thicknesses by those of the baseline, largest moves of points of the free form (m), and what the
worst cell must keep of its volume, by the bound of `Quality`."""

BEST = ("volume", "chord", "thickness", "surface_area", "projected_area", "volume_ks")
"""What comes out of the optimum."""

DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}

VIEW = Camera(focus=(1.0, 0.0, 1.2), direction=(-0.5, 0.7, 1.0), height=5.0)
"""From where the pictures are seen: outboard, upstream and above."""


def make_mesh(path: Path, size: float) -> None:
    """Make the mesh with edges of a length on the walls, and write it."""
    try:
        import gmsh
    except (ImportError, OSError) as error:  # OSError where the system lacks a library that the wheel needs
        raise bm.InputError(f"the mesh is made by Gmsh ({error}): pip install 'bspline_mdao[gmsh]'") from None
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    occ, field = gmsh.model.occ, gmsh.model.mesh.field
    wing = occ.addThruSections([section(occ, 0.0, CHORDS[0], 0.0), section(occ, TIP_AT, CHORDS[1], SPAN)])[:1]
    fuselage = [(3, occ.addSphere(MIDDLE, 0.0, 0.0, 1.0))]
    occ.rotate(fuselage, MIDDLE, 0.0, 0.0, 0.0, 1.0, 0.0, np.pi / 2.0)  # its poles are nose and tail
    occ.dilate(fuselage, MIDDLE, 0.0, 0.0, 0.5 * LENGTH, RADIUS, RADIUS)
    fluid, _ = occ.cut([(3, occ.addBox(-FAR, -FAR, 0.0, 2.0 * FAR, 2.0 * FAR, FAR))], wing + fuselage)
    occ.synchronize()
    markers = {name: [] for name in ("symmetry", "fuselage", "wing", "farfield")}
    for _, face in gmsh.model.getEntities(2):
        outboard = occ.getCenterOfMass(2, face)[2]
        markers[list(markers)[np.searchsorted([1e-6, RADIUS, 1.1 * SPAN], outboard)]].append(face)
    for name, faces in markers.items():
        gmsh.model.addPhysicalGroup(2, faces, name=name)
    gmsh.model.addPhysicalGroup(3, [volume for _, volume in fluid], name="fluid")
    distance, growing = field.add("Distance"), field.add("MathEval")
    field.setNumbers(distance, "SurfacesList", markers["wing"] + markers["fuselage"])
    field.setNumber(distance, "Sampling", 100)
    field.setString(growing, "F", f"{size} + 0.3 * F{distance}")
    field.setAsBackgroundMesh(growing)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.mesh.generate(3)
    gmsh.write(str(path))
    gmsh.finalize()


def section(occ, start: float, chord: float, z: float) -> int:
    """Draw the section of the wing, NACA 0012 with a closed trailing edge, upper side first."""
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 16)))
    y = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    upper, lower = ([occ.addPoint(start + chord * a, sign * chord * b, z) for a, b in zip(x, y)] for sign in (1, -1))
    return occ.addWire([occ.addSpline(upper), occ.addSpline([upper[-1], *lower[-2:0:-1], upper[0]])])


def move(model: MeshModel, text: str) -> np.ndarray:
    """Move the mesh by a deformation of only the wing."""
    wing = bm.movers.moving_mesh(model, "wing")
    asked = model.deformed(bm.design.parse_deformation(text, model, wing))
    return model.node_map.at(model.mover_of(wing).move(model.control_points, asked).points).nodes


def widen(model: MeshModel) -> np.ndarray:
    """Move the mesh by a wider fuselage, which pushes the wing out."""
    walls = model.mesh.points[model.wall_rows]
    asked = walls + np.minimum(walls, RADIUS) * [0.0, 0.0, WIDER - 1.0]
    return model.node_map.at(model.mover.move(model.control_points, asked).points).nodes


def judge(mesh: MixedMesh, nodes: np.ndarray) -> dict:
    """Count inverted cells, and find the smallest volume by that before and how far a node has moved (m)."""
    after = mesh.quality(nodes)
    ratios, moved = after.volumes / mesh.quality().volumes, np.linalg.norm(nodes - mesh.points, axis=1)
    return {"n_inverted": after.is_inverted.sum(), "smallest_ratio": ratios.min(), "displacement": moved.max()}


def pose(model: MeshModel) -> om.Problem:
    """Pose the problem of the largest volume. Not yet set up."""
    wing, walls = bm.DesignSurface.of(model, "wing"), bm.measures.SurfaceGrid.of(model)
    box = bm.design.Lattice.hexahedron(around_wing(0.0, 1.01 * SPAN, (-0.05, 1.05), 0.07), n=(5, 2, 5))
    heights = bm.design.FreeForm("heights", box, where=np.s_[:, :, 2:], direction="y")  # none that moves the root
    lines = around_wing(1.2 * RADIUS, 0.97 * SPAN, (0.1, 0.8), 0.0)[:, 0]
    measures = [  # of all walls: the wing alone is open where it meets the fuselage
        bm.measures.EnclosedVolume.of(walls),
        bm.measures.SurfaceArea.of(walls, relative=True),
        bm.measures.ProjectedArea.of(walls, [0.0, 1.0, 0.0], relative=True),
        bm.measures.Thickness.grid(walls, 4, 4, relative=True, leading=lines[0], trailing=lines[1]),
    ]
    variables = [heights, bm.design.Chord("chord", wing.axis, stations=4)]
    problem = om.Problem(wing.grid_movement(variables, measures=measures, quality=("volume_ks",)), reports=None)
    top, chords = problem.model, np.array([[1.0, 1.0], *[CHORD] * 3])  # the first is that of the root
    top.add_design_var("heights", lower=-HEIGHT, upper=HEIGHT, ref=HEIGHT, units="m")
    top.add_design_var("chord", lower=chords[:, 0], upper=chords[:, 1])
    top.add_constraint("surface_area", upper=1.0)
    top.add_constraint("projected_area", equals=1.0)
    top.add_constraint("thickness", lower=THICKNESS[0], upper=THICKNESS[1])
    top.add_constraint("volume_ks", lower=WORST)
    top.add_objective("volume", scaler=-1.0, units="m**3")
    return problem


def around_wing(low: float, high: float, parts, height: float) -> np.ndarray:
    """Corners between two stations, two parts of the chord, and as many chords below and above; shape (2, 2, 2, 3)."""
    z = np.array([low, high])
    start, chord = TIP_AT * z / SPAN, CHORDS[0] + (CHORDS[1] - CHORDS[0]) * z / SPAN
    return np.array([[np.stack([start + a * chord, b * chord, z], axis=1) for b in (-height, height)] for a in parts])


def main(paper: bool = False, figures=None, output=None, quick: bool = False, drivers=DRIVERS) -> dict:
    """Make the mesh, move it, and find the largest volume with every driver.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`.
    figures : path-like, optional
        Folder for ``wing_body_su2.png``.
    output : path-like, optional
        Folder for the mesh ``wing_body.su2`` and, by the names of their moves, the moved ones; a temporary one by
        default.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        ``n_points`` and ``n_cells`` of the mesh; by ``moves``, the ``optimum`` among them, what `judge` returns; the
        ``volume`` of both bodies on the baseline (m^3); ``best``: the volume at the optimum, factors on chords and
        thicknesses, wetted and planform areas by those before, and the bound of cells; by ``drivers`` what
        `RecordedRun.numbers` returns; by how much they ``differ``, see `disagreement`; and ``totals``, see
        `check_totals`.
    """
    (size, tolerance), runs = pick_size(SIZES, paper, quick), {}
    with tempfile.TemporaryDirectory() as spare:
        folder = Path(output or spare)
        folder.mkdir(parents=True, exist_ok=True)
        make_mesh(folder / "wing_body.su2", size)
        file = bm.files.read_mesh(folder / "wing_body.su2")
        model = MeshModel.of(file.mesh, {name: guess.kind for name, guess in marker_kinds(file.mesh).items()})
        states = {text: move(model, text) for text in MOVES} | {f"fuselage={WIDER}": widen(model)}
        for name, make_driver in drivers.items():
            problem = pose(model)
            problem.driver = make_driver(tolerance, 200)
            with recorded(problem) as runs[name]:
                problem.run_driver()
        states["optimum"] = problem.get_val("grid").reshape(-1, 3).copy()
        for text, nodes in states.items():
            file.write(folder / f"{text}.su2", nodes)
    if figures:
        draw(figures, file.mesh, {"baseline": file.mesh.points} | states, runs)
    best = {name: problem.get_val(name).copy() for name in BEST}
    return {"n_points": file.mesh.n_points, "n_cells": file.mesh.n_cells} | {
        "moves": {text: judge(file.mesh, nodes) for text, nodes in states.items()},
        "volume": runs[name].history["volume"][0].item(),
        "best": best,
        "drivers": {name: run.numbers() for name, run in runs.items()},
        "differ": disagreement(runs),
        "totals": check_totals(perturb_design(problem))._asdict(),
    }


def draw(folder, mesh: MixedMesh, states: dict, runs: dict) -> None:
    """Draw the walls and the plane of symmetry in every state, and the histories."""
    with figure(folder, "wing_body_su2", (14.0, 6.0), n_colours=128) as canvas:
        *pictures, history = canvas.subplots(2, 4).flat
        for axes, (text, points) in zip(pictures, states.items()):
            for name, color in (("symmetry", "white"), ("fuselage", GRAY), ("wing", BLUE)):
                draw_faces(axes, points[mesh.markers[name][:, :3]], color)
            axes.set(title=text, xlim=(-4.5, 3.9), ylim=(-2.2, 2.4), aspect="equal")
            axes.set_axis_off()
        draw_history(history, runs, "volume", "volume (m$^3$)", log=False)


def draw_faces(axes, corners: np.ndarray, color: str) -> None:
    """Draw triangles, shape (n, 3, 3), as they are seen from outboard, those at the back first."""
    from matplotlib.collections import PolyCollection

    seen = VIEW.project(corners.reshape(-1, 3)).reshape(-1, 3, 3)
    axes.add_collection(PolyCollection(seen[np.argsort(seen[..., 2].sum(1)), :, :2], fc=color, ec="black", lw=0.15))


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/wing_body_su2.png'
