"""Deflect a flap.

Flaps through 25 degrees either way, with a blended hinge and behind a gap, and a whole section through a full turn. A
plain flap of a section with a boundary layer, one of an M6 wing over a part of its span, and one behind a gap in an
unstructured mesh turn about their hinges; an all-moving section turns by 180 degrees and more. It takes half a minute.
The output is inverted cells, worst cells and the heights of the first cells at walls at every angle, and a picture.
"""

from __future__ import annotations

import numpy as np
import openmdao.api as om
from scipy.spatial import Delaunay

import bspline_mdao as bm
from bspline_mdao.design import Hinge, OnPatch, Rotation
from bspline_mdao.plotting import BLUE, GRAY, GREEN, ORANGE, PURPLE, draw_net, figure
from bspline_mdao.scripts import pick_size, run

SIZES = {
    "quick": (64, (13, 9, 15), (9, 5, 9)),
    "default": (160, (25, 15, 33), (15, 7, 19)),
    "paper": (320, (49, 33, 65), (15, 9, 21)),
}
"""Cells around the section, nodes of the wing's blocks, and their control points: some within the blends."""

ANGLES, TURNS = np.linspace(-25.0, 25.0, 11), np.linspace(0.0, 400.0, 11)
"""Angles of flaps and of the whole section (deg)."""

HINGE, BLEND = 0.7, 0.08
"""Where flaps begin, and the length over which their turning fades, in chords."""

MAIN, FLAP, SLOT = 0.75, 0.3, (0.77, -0.025)
"""Chords of the main element and of the flap behind the gap, and where that begins."""

VIEW = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.6]])
"""Directions on paper, to the right and up, of x, y and z: sections as they are, those outboard higher up."""

COLORS = {"section": BLUE, "wing": GREEN, "gap": ORANGE, "whole section": PURPLE}


def main(paper: bool = False, quick: bool = False, figures=None) -> dict:
    """Turn every flap through all angles.

    Parameters
    ----------
    paper, quick : bool
        Finer grids, or coarser ones.
    figures : path-like, optional
        Folder for ``flap_deflection.png``.

    Returns
    -------
    dict
        Of ``section``, ``wing``, ``gap`` and ``whole section``, for each of the ``angles`` (deg): ``n_inverted`` cells,
        the ``worst`` cell (smallest corner of blocks by that before, smallest volume of the mesh by its own before) and
        ``heights``, least and largest height of first cells at walls by those before.
    """
    n_around, shape, n_control = pick_size(SIZES, paper, quick)
    g = bm.generators
    section = bm.fit_grid(g.section_o_grid(g.naca_section(0.12), n_around=n_around, far=20.0, off_wall=2e-4))
    wing, slotted = bm.fit_grid(g.onera_m6_grid(shape), n_control=n_control), bm.meshes.MeshModel.of(*slotted_mesh(96))
    line = Hinge((HINGE, 0.0, 1.0), (HINGE, 0.0, 0.0))  # the trailing edge goes down
    of_wing = Hinge.on_chord(bm.DesignSurface.of(wing).mesh, HINGE, span=(0.35, 0.75))
    within = Hinge(*((SLOT[0] + 0.1 * FLAP, SLOT[1], z) for z in (1.0, 0.0)))
    cases = {
        "section": (section, Rotation("angle", line, blend=BLEND), ANGLES, False),
        "wing": (wing, Rotation("angle", of_wing, blend=BLEND, ends=0.15), ANGLES, False),
        "gap": (slotted, Rotation("angle", within, OnPatch(slotted, "flap")), ANGLES, False),
        "whole section": (section, Rotation("angle", Hinge((0.4, 0.0, 1.0), (0.4, 0.0, 0.0))), TURNS, True),
    }
    states = {name: turn(*case) for name, case in cases.items()}
    numbers = {name: {"angles": case[2].tolist(), **judge(case[0], states[name])} for name, case in cases.items()}
    if figures:
        draw(figures, section, wing, slotted, states, numbers)
    return numbers


def turn(model, rotation: Rotation, angles: np.ndarray, comoving: bool) -> list[np.ndarray]:
    """Nodes of a grid or mesh (m) at every angle; comoving, its outer boundary follows."""
    movement = bm.DesignSurface.of(model).grid_movement([rotation], fit=False, comoving=comoving, require_valid=False)
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("movement", movement, promotes=["*"])
    problem.setup()
    states = []
    for angle in angles:
        problem.set_val("angle", angle, units="deg")
        problem.run_model()
        states.append(problem.get_val("grid").reshape(-1, 3).copy())
    return states


def judge(model, states: list[np.ndarray]) -> dict:
    """Judge the cells and the heights at walls of every state, see `main`."""
    if isinstance(model, bm.meshes.MeshModel):
        walls, before = model.node_map.embedded.walls, model.mesh.quality().volumes
        qualities = [model.mesh.quality(nodes) for nodes in states]
        ratios = [walls.heights(nodes) / walls.heights(model.mesh.points) for nodes in states]
        return {
            "n_inverted": [int(quality.is_inverted.sum()) for quality in qualities],
            "worst": [float((quality.volumes / before).min()) for quality in qualities],
            "heights": [(float(each.min()), float(each.max())) for each in ratios],
        }
    baseline = model.regenerate()
    quality = bm.grids.GridQuality.of_baseline(baseline)
    rest, *reports = (bm.grids.report_quality(quality, x) for x in (baseline.to_vector().reshape(-1, 3), *states))
    ends = [(min(h.ratio_min for h in r.heights), max(h.ratio_max for h in r.heights)) for r in reports]
    worst = [report.min_corner / rest.min_corner for report in reports]
    return {"n_inverted": [report.n_inverted for report in reports], "worst": worst, "heights": ends}


def slotted_mesh(n_around: int) -> tuple[bm.meshes.MixedMesh, dict[str, str]]:
    """Triangles about a section with a flap behind a gap, in one layer of wedges, and the kinds of its markers."""
    g, rings = bm.generators, []
    for size, place, n in ((MAIN, (0.0, 0.0), n_around), (FLAP, SLOT, n_around // 2)):
        nodes = g.section_o_grid(g.naca_section(0.12), n_around=n, far=20.0).blocks[0].nodes[:-1, :, 0, :2]
        rings.append(np.array(place) + size * nodes.swapaxes(0, 1))
    bodies = [each[0] for each in rings]
    plane, outlines = np.concatenate(bodies), [Delaunay(body) for body in bodies]
    for ring in sorted([*rings[0][1:], *rings[1][1:-12]], key=lambda ring: np.ptp(ring[:, 0])):
        gaps = np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1)
        is_free = np.linalg.norm(ring[:, None] - plane, axis=2).min(axis=1) > 0.6 * gaps
        is_free &= np.all([outline.find_simplex(ring) < 0 for outline in outlines], axis=0)
        plane = np.concatenate([plane, ring[is_free]])
    corners, starts = Delaunay(plane).simplices, np.cumsum([0, *map(len, bodies)])
    edges = plane[corners[:, 1:]] - plane[corners[:, :1]]
    corners[np.linalg.det(edges) < 0.0] = corners[np.linalg.det(edges) < 0.0][:, [0, 2, 1]]
    is_solid = np.any([((corners >= a) & (corners < b)).all(axis=1) for a, b in zip(starts, starts[1:])], axis=0)
    corners, n = corners[~is_solid], len(plane)
    loops = {"main": np.arange(starts[1]), "flap": np.arange(starts[1], starts[2]), "far": np.arange(n - n_around, n)}
    points = np.concatenate([np.column_stack([plane, np.full(n, z)]) for z in (0.0, 1.0)])
    ends = {name: np.roll(ids, -1) for name, ids in loops.items()}
    markers = {name: np.stack([ids, ends[name], ends[name] + n, ids + n], axis=1) for name, ids in loops.items()}
    wedges = np.concatenate([corners, corners + n], axis=1)
    kinds = {"main": "wall", "flap": "wall", "far": "farfield"}
    return bm.meshes.MixedMesh(points, {"wedge": wedges}, markers, n_copies=2), kinds


def draw(folder, section, wing, slotted, states, numbers) -> None:
    """Draw the grids with their flaps down, the section turned by 200 degrees, and what became of cells and heights."""
    with figure(folder, "flap_deflection", size=(13.0, 7.6), n_colours=128) as canvas:
        (plain, gap, of_wing), (worst, heights, turned) = canvas.subplots(2, 3)
        shape = section.topology.shapes[0]
        for axes, name, number in ((plain, "section", -1), (turned, "whole section", len(TURNS) // 2)):
            net = states[name][number].reshape(*shape, 3)[:, :, 0, :2]
            draw_net(axes, net, color=GRAY, linewidth=0.25)
            axes.plot(*net[:, 0].T, color=COLORS[name])
        corners = slotted.mesh.cells["wedge"][:, :3]
        nodes = states["gap"][-1]
        gap.triplot(nodes[:, 0], nodes[:, 1], corners, color=GRAY, linewidth=0.3)
        for name in ("main", "flap"):
            loop = slotted.mesh.markers[name][:, 0]
            gap.plot(*nodes[np.append(loop, loop[0]), :2].T, color=COLORS["gap"])
        surface = bm.measures.SurfaceGrid.of(wing)
        for nodes, color in ((surface.points, GRAY), (states["wing"][-1][surface.rows], COLORS["wing"])):
            for face in surface.faces:  # sections, one behind the other
                along = face if np.ptp(nodes[face[:, 0], 2]) < np.ptp(nodes[face[0], 2]) else face.T
                of_wing.plot(*(nodes[along[:, ::2]] @ VIEW).transpose(2, 0, 1), color=color, lw=0.8)
        for name in ("section", "wing", "gap"):
            found = numbers[name]
            worst.plot(found["angles"], found["worst"], "o-", ms=3, color=COLORS[name], label=name)
            bounds = np.transpose(found["heights"])
            heights.fill_between(found["angles"], *bounds, color=COLORS[name], alpha=0.3, lw=0)
            heights.plot(found["angles"], bounds.T, color=COLORS[name], lw=1.4)
        plain.set(xlim=(0.6, 1.06), ylim=(-0.22, 0.12), title="25 degrees, blended over 8 % of the chord")
        gap.set(xlim=(0.6, 1.06), ylim=(-0.22, 0.12), title="25 degrees behind a gap")
        of_wing.set(title="25 degrees, from 35 to 75 % of the span", xlabel="$x$ (m)", ylabel="$y + 0.6 z$ (m)")
        turned.set(xlim=(-0.4, 1.2), ylim=(-0.6, 0.6), title="all of the section by 200 degrees")
        worst.set(xlabel="angle (deg)", ylabel="worst cell relative to 0 deg", ylim=(0.0, 1.05))
        heights.set(xlabel="angle (deg)", ylabel="range of first heights relative to 0 deg")
        worst.legend()
        for axes in (plain, gap, turned):
            axes.set(aspect="equal", xlabel="$x / c$", ylabel="$y / c$")
        of_wing.set_aspect("equal")


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/flap_deflection.png'
