"""Meshes that ride along, which the tests share."""

import re
import shutil
from functools import cache

import h5py
import numpy as np

from bspline_mdao import fit_grid
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.core.riding.wall_faces import GridBoundary
from bspline_mdao.files import read_mesh
from bspline_mdao.generators import Spacing, naca_section, onera_m6_grid, section_o_grid
from bspline_mdao.grids.io.cgns import write_base
from bspline_mdao.grids.io.cgns_nodes import add_node
from bspline_mdao.grids.io.meshes.foam_lists import FoamFile
from bspline_mdao.meshes import MixedMesh
from bspline_mdao.movers import LinearElasticity, moving_mesh

SPACING = Spacing(off_wall=1e-4)

BOX = np.array([[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0], [0, 0, 5], [2, 0, 5], [2, 3, 5], [0, 3, 5]], dtype=float)

HALVES = np.array([[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]])
"""Two wedges of a hexahedron."""


@cache
def model():
    """A wing with a boundary layer."""
    return fit_grid(onera_m6_grid((9, 11, 9), SPACING), n_control=(6, 6, 6))


@cache
def moved(text):
    """Its control points after a deformation, and the deformation."""
    mesh = moving_mesh(model())
    deformation = parse_deformation([text], model(), mesh)
    initial = model().control_points
    return LinearElasticity(mesh, n_increments=1).move(
        initial, deformation.apply(initial[mesh.surface_ids])
    ).points, deformation


def twisted():
    """Its control points after a twist, and the twist."""
    return moved("twist=10deg")


def corners_of(ids):
    """Corners of the cells of a block, shape (n_cells, 8)."""
    low, high = ids[:, :, :-1], ids[:, :, 1:]
    around = [(slice(None, -1),) * 2, (slice(1, None), slice(None, -1)), (slice(1, None),) * 2]
    around.append((slice(None, -1), slice(1, None)))
    return np.stack([half[part] for half in (low, high) for part in around], axis=-1).reshape(-1, 8)


def joined(grid):
    """Nodes of a grid, each once, and the corners of its cells."""
    points = grid.to_vector().reshape(-1, 3)
    unique, numbers = np.unique(points, axis=0, return_inverse=True)
    cells, first = [], 0
    for shape in grid.shapes:
        n = int(np.prod(shape))
        cells.append(corners_of(numbers.ravel()[first : first + n].reshape(shape)))
        first += n
    return unique, np.concatenate(cells)


@cache
def mesh():
    """A mesh about the same wing with other nodes: hexahedra, stout ones cut into pyramids; with markers."""
    points, cells = joined(onera_m6_grid((8, 12, 10), SPACING))
    lengths = np.linalg.norm(points[cells[:, [1, 3, 4]]] - points[cells[:, [0]]], axis=2)
    is_cut = lengths.max(axis=1) < 5.0 * lengths.min(axis=1)
    cut = cells[is_cut]
    middles = len(points) + np.arange(len(cut))[:, None]
    faces = cut[:, [[0, 1, 2, 3], [7, 6, 5, 4], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3], [3, 7, 4, 0]]]
    pyramids = np.concatenate([faces, np.broadcast_to(middles[:, None], (len(cut), 6, 1))], axis=2).reshape(-1, 5)
    points = np.concatenate([points, points[cut].mean(axis=1)])
    kinds = {"hexahedron": cells[~is_cut], "pyramid": pyramids}
    bare = MixedMesh(points, kinds)
    skin = bare.skin
    is_wall = GridBoundary.of(model()).on_walls(points[skin])
    in_plane = (points[skin][:, :, 2] == 0.0).all(axis=1) & ~is_wall
    markers = {"wing": skin[is_wall], "symmetry": skin[in_plane], "far": skin[~is_wall & ~in_plane]}
    return MixedMesh(points, kinds, markers)


def su2_text(mesh):
    """The text of a mesh in the format of SU2."""
    kinds, n = {"tetra": 10, "hexahedron": 12, "wedge": 13, "pyramid": 14}, 0
    lines = ["% made by hand", "NDIME= 3", f"NELEM= {mesh.n_cells}"]
    for kind, cells in mesh.cells.items():
        lines += [f"{kinds[kind]} {' '.join(map(str, row))} {n + k}" for k, row in enumerate(cells.tolist())]
        n += len(cells)
    lines.append(f"NPOIN= {mesh.n_points}")
    lines += [f"  {x:.16e}\t{y:.16e} {z:.16e} {k}" for k, (x, y, z) in enumerate(mesh.points.tolist())]
    lines.append(f"NMARK= {len(mesh.markers)}")
    for name, faces in mesh.markers.items():
        lines += [f"MARKER_TAG= {name}", f"MARKER_ELEMS= {len(faces)}"]
        lines += [f"5 {a} {b} {c}" if c == d else f"9 {a} {b} {c} {d}" for a, b, c, d in faces.tolist()]
    return "\n".join([*lines, "FFD_NBOX= 0", ""])


@cache
def section():
    """A section, fitted."""
    return fit_grid(section_o_grid(naca_section(0.12), n_around=48, far=20.0))


@cache
def plane_mesh():
    """A mesh of two dimensions about the same section: nodes, triangles far away, quads near it, and the airfoil."""
    grid = section_o_grid(naca_section(0.12), n_around=70, far=14.0).blocks[0].nodes[:-1, :, 0, :2]
    ids = np.arange(grid[..., 0].size).reshape(grid.shape[:2])
    ids = np.vstack([ids, ids[:1]])
    quads = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1)
    near, away = quads[:, :9].reshape(-1, 4), quads[:, 9:].reshape(-1, 4)
    lines = np.stack([ids[:-1, 0], ids[1:, 0]], axis=1)
    return grid.reshape(-1, 2), np.concatenate([away[:, [0, 1, 2]], away[:, [0, 2, 3]]]), near, lines


def plane_su2_text():
    """The text of this mesh in the format of SU2."""
    points, triangles, quads, lines = plane_mesh()
    return "\n".join(
        [
            "% a section",
            "NDIME= 2",
            f"NELEM= {len(triangles) + len(quads)}",
            *(" ".join(map(str, (5, *row, n))) for n, row in enumerate(triangles.tolist())),
            *(" ".join(map(str, (9, *row, n))) for n, row in enumerate(quads.tolist())),
            f"NPOIN= {len(points)}",
            *(f"{x:.16e}  {y:.16e} {n}" for n, (x, y) in enumerate(points.tolist())),
            "NMARK= 1",
            "MARKER_TAG= airfoil",
            f"MARKER_ELEMS= {len(lines)}",
            *(f"3 {a} {b}" for a, b in lines.tolist()),
            "",
        ]
    )


def add_elements(zone, name, kind, numbers, corners):
    """Write a section of elements of CGNS."""
    section = add_node(zone, name, "Elements_t", np.array([kind, 0], np.int32))
    add_node(section, "ElementRange", "IndexRange_t", np.array(numbers, np.int32))
    add_node(section, "ElementConnectivity", "DataArray_t", np.asarray(corners, np.int32))


def write_plane_cgns(path, axes, n_axes):
    """Write this mesh as a CGNS base of two dimensions, in some of two or three axes: quads in mixed elements."""
    points, triangles, quads, lines = plane_mesh()
    nodes = np.zeros((len(points), n_axes))
    nodes[:, axes] = points
    ends = np.cumsum([len(triangles), len(quads), len(lines)])
    with h5py.File(path, "w", track_order=True) as file:
        base = write_base(file, 2)
        base[" data"][1] = n_axes
        zone = add_node(base, "zone", "Zone_t", np.array([[len(points)], [ends[1]], [0]], np.int32))
        add_node(zone, "ZoneType", "ZoneType_t", "Unstructured")
        coordinates = add_node(zone, "GridCoordinates", "GridCoordinates_t")
        for axis, values in zip("XYZ", nodes.T):
            add_node(coordinates, f"Coordinate{axis}", "DataArray_t", np.ascontiguousarray(values))
        add_elements(zone, "triangles", 5, (1, ends[0]), triangles.ravel() + 1)
        mixed = np.insert(quads + 1, 0, 7, axis=1).ravel()
        add_elements(zone, "quads", 20, (ends[0] + 1, ends[1]), mixed)
        add_elements(zone, "lines", 3, (ends[1] + 1, ends[2]), lines.ravel() + 1)
        airfoil = add_node(add_node(zone, "ZoneBC", "ZoneBC_t"), "airfoil", "BC_t", "BCWall")
        add_node(airfoil, "PointRange", "IndexRange_t", np.array([[ends[1] + 1, ends[2]]], np.int32))
        add_node(airfoil, "GridLocation", "GridLocation_t", "EdgeCenter")


def binary_folder(folder, arch):
    """The same mesh in binary, as OpenFOAM writes it: faces are two lists, and an empty list has no brackets."""
    made, order = folder.parent / "binary" / "polyMesh", "<" if arch.startswith("LSB") else ">"
    label, scalar = (
        f"{order}{k}{int(re.search(rf'{n}=(..)', arch)[1]) // 8}" for k, n in (("i", "label"), ("f", "scalar"))
    )
    shutil.copytree(folder, made)
    read = read_mesh(folder)
    lists = {"points": [(read.mesh.n_points, read.mesh.points.astype(scalar))]}
    corners, sizes = FoamFile.read(folder, "faces").faces()
    starts = np.concatenate([[0], np.cumsum(sizes)])
    lists["faces"] = [(len(starts), starts.astype(label)), (len(corners), corners.astype(label))]
    for name in ("owner", "neighbour"):
        values = FoamFile.read(folder, name).labels()
        lists[name] = [(len(values), values.astype(label))]
    for name, parts in lists.items():
        head = (folder / name).read_text().partition("}")[0].replace("format ascii", f'format binary; arch "{arch}"')
        head = head.replace("faceList", "faceCompactList") + "}\n// * * * (1) * * * //\n\n"
        bodies = [f"\n{n}\n".encode() + (b"(" + values.tobytes() + b")" if n else b"") for n, values in parts]
        (made / name).write_bytes(head.encode() + b"".join(bodies) + b"\n\n// end ) //\n")
    return made


def write_boxes_cgns(path):
    """Write two zones side by side: two wedges in mixed elements, and a hexahedron; single precision in y."""
    with h5py.File(path, "w", track_order=True) as file:
        base = write_base(file, 3)
        wedges = np.concatenate([[14, *row] for row in HALVES + 1])
        for name, shift, kind, cells in (("left", 0.0, 20, wedges), ("right", 2.0, 17, np.arange(8) + 1)):
            n = 2 if kind == 20 else 1
            zone = add_node(base, name, "Zone_t", np.array([[8], [n], [0]], np.int32))
            add_node(zone, "ZoneType", "ZoneType_t", "Unstructured")
            coordinates = add_node(zone, "GridCoordinates", "GridCoordinates_t")
            for axis, values in zip("XYZ", (BOX + [shift, 0.0, 0.0]).T):
                kept = values.astype(np.float32 if axis == "Y" else np.float64)
                add_node(coordinates, f"Coordinate{axis}", "DataArray_t", np.ascontiguousarray(kept))
            add_elements(zone, "cells", kind, (1, n), cells)
            add_elements(zone, "faces", 7, (n + 1, n + 1), np.array([1, 2, 3, 4]))
            conditions = add_node(zone, "ZoneBC", "ZoneBC_t")
            floor = add_node(conditions, f"bc {name}", "BC_t", "BCWall")
            add_node(floor, "FamilyName", "FamilyName_t", "floor")
            add_node(floor, "PointRange", "IndexRange_t", np.array([[n + 1, n + 1]], np.int32))
            solution = add_node(zone, "FlowSolution", "FlowSolution_t")
            add_node(solution, "Pressure", "DataArray_t", np.arange(8.0))
