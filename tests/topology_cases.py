"""Grids whose topology is known, for the tests of coincidence, topology and sharing."""

from itertools import permutations, product

import h5py
import numpy as np

from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Orientation, Window

ORIENTATIONS = [Orientation(perm, flip) for perm in permutations(range(3)) for flip in product((False, True), repeat=3)]


def grid_of(*blocks, patches=()):
    """Grid of arrays of nodes."""
    return Grid(
        tuple(Block(np.ascontiguousarray(nodes, dtype=float), f"block {n + 1}") for n, nodes in enumerate(blocks)),
        tuple(patches),
    )


def patch(kind, *windows, name=None):
    """Patch of windows."""
    return Patch(name or kind, kind, windows)


def box(x, y, z):
    """Nodes of a box with grid lines at given coordinates."""
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)


def smooth_box(ni, nj, nk):
    """Nodes of a box with curved, unevenly spaced grid lines."""
    xi, eta, zeta = np.moveaxis(box(*(np.linspace(0.0, 1.0, n) for n in (ni, nj, nk))), -1, 0)
    x = xi**1.3 + 0.1 * np.sin(2 * eta) * zeta
    y = eta + 0.2 * xi**2 + 0.05 * zeta
    return np.stack([x, y, 0.7 * zeta**1.2 - 0.1 * xi * eta], axis=-1)


def split(nodes, *cuts):
    """Blocks of a box cut at the given indices of each direction, the last direction fastest."""
    intervals = [list(zip([0, *cut], [*cut, n - 1])) for cut, n in zip(cuts, nodes.shape)]
    return [nodes[i0 : i1 + 1, j0 : j1 + 1, k0 : k1 + 1] for (i0, i1), (j0, j1), (k0, k1) in product(*intervals)]


def turned_and_shuffled(grid, rng):
    """The same grid with its blocks turned at random and in random order, and the old row of each new row."""
    rows = np.split(np.arange(grid.n_nodes), np.cumsum([block.nodes.size // 3 for block in grid.blocks])[:-1])
    blocks, old_rows = [], []
    for number in rng.permutation(len(grid.blocks)):
        turn = ORIENTATIONS[rng.integers(48)]
        nodes = grid.blocks[number].nodes
        blocks.append(turn.apply(nodes))
        old_rows.append(turn.apply(rows[number].reshape(nodes.shape[:3])).ravel())
    return grid_of(*blocks), np.concatenate(old_rows)


def o_grid(n_around=17, n_off=6, n_span=4, radius=0.5):
    """One block around a cylinder, or about an axis if the radius is zero; directions: around, off, along."""
    angle = np.linspace(0.0, 2.0 * np.pi, n_around)[:, None, None]
    off = radius + np.linspace(0.0, 1.0, n_off)[None, :, None] ** 1.2
    along = np.linspace(0.0, 2.0, n_span)[None, None, :]
    return np.stack(np.broadcast_arrays(off * np.cos(angle), off * np.sin(angle), along), axis=-1)


def c_grid(n_wake=5, n_wing=8, n_off=6, n_span=4, span=None):
    """One block about a wing in parabolic coordinates, k off the wing; the wing ends at ``span`` cells if given.

    Nodes on kmin fold onto each other along the wake, and beyond the tip on both sides of the leading edge.
    """
    xi = np.linspace(-1.0, 1.0, 2 * (n_wake + n_wing) + 1)[:, None, None]
    y = np.linspace(0.0, 1.0, n_span)[None, :, None]
    te = abs(xi[n_wake, 0, 0])
    chordwise = np.clip(te**2 - xi**2, 0.0, None)
    spanwise = 1.0 if span is None else np.clip(y[0, span, 0] - y, 0.0, None)
    chordwise[[n_wake, -n_wake - 1]] = 0.0
    wall = 0.2 * chordwise * spanwise
    eta = wall + (1.0 - wall) * np.linspace(0.0, 1.0, n_off)[None, None, :] ** 1.5
    return np.stack(np.broadcast_arrays(xi**2 - eta**2, y, 2.0 * xi * eta), axis=-1)


def sphere_octants(inner=0.5, shape=(4, 5, 6)):
    """Eight blocks (radius, polar angle, azimuth) around the origin with a pole line in each."""
    radius = np.linspace(inner, 1.5, shape[0])[:, None, None]
    blocks = []
    for top, quadrant in product(range(2), range(4)):
        polar = np.linspace(0.0, 0.5 * np.pi, shape[1])[None, :, None] + 0.5 * np.pi * top
        azimuth = np.linspace(0.0, 0.5 * np.pi, shape[2])[None, None, :] + 0.5 * np.pi * quadrant
        x, y = radius * np.sin(polar) * np.cos(azimuth), radius * np.sin(polar) * np.sin(azimuth)
        blocks.append(np.stack(np.broadcast_arrays(x, y, radius * np.cos(polar)), axis=-1))
    return blocks


PLATE_CUTS = ([3, 7], [4], [3])
PLATE_NODES = box(np.linspace(-1.0, 2.0, 12) ** 3, np.linspace(0.0, 3.0, 9) ** 1.2, np.linspace(-1.0, 1.0, 7))
"""Around a plate in z = 0 over i = 3 to 7 and j = 0 to 4; symmetry plane j = 0."""


def twelve_block_plate(is_declared=True):
    """Upstream, plate, downstream x inboard, outboard x below, above."""
    blocks = split(PLATE_NODES, *PLATE_CUTS)
    below, above = 4, 5
    windows = [
        Window.whole(below, blocks[below].shape[:3]).face(5),
        Window.whole(above, blocks[above].shape[:3]).face(4),
    ]
    return grid_of(*blocks, patches=[patch("wall", *windows)] if is_declared else ())


def two_block_plate(is_declared=True):
    """One block below and one above, the plate a window of each."""
    blocks = split(PLATE_NODES, [], [], [3])
    windows = [Window(0, (3, 0, 3), (7, 4, 3)), Window(1, (3, 0, 0), (7, 4, 0))]
    return grid_of(*blocks, patches=[patch("wall", *windows)] if is_declared else ())


def labels_of_points(grid, digits=9):
    """Label of the point of each node of a grid, by rounded coordinates."""
    points = np.round(grid.to_vector().reshape(-1, 3), digits) + 0.0
    return np.unique(points, axis=0, return_inverse=True)[1].ravel()


def labels_of_rows(topology, sharing):
    """Label of each row of the grid vector: the row that stands for it."""
    labels = np.arange(topology.n_nodes)
    labels[sharing.copies[:, 0]] = sharing.copies[:, 1]
    return labels


def are_same_partition(a, b):
    """Whether two labellings put the same members together."""
    n_pairs = len(np.unique(np.stack([a, b], axis=1), axis=0))
    return n_pairs == len(np.unique(a)) == len(np.unique(b))


def connected_rows(rows, donor_rows, point_range, donor_range, transform):
    """Rows of the nodes of a connection and of their donors, as the CGNS standard defines them (SIDS, 8.2)."""
    (begin, end), donor_begin = point_range, donor_range[0]
    steps = np.indices(np.abs(end - begin) + 1).reshape(3, -1) * np.where(end < begin, -1, 1)[:, None]
    donor = np.zeros_like(steps)
    for d, to in enumerate(transform):
        donor[abs(to) - 1] = np.sign(to) * steps[d]
    return rows[tuple(begin[:, None] + steps)], donor_rows[tuple(donor_begin[:, None] + donor)]


def declared_connections(path):
    """Names, nodes and one-to-one connections of the zones of a CGNS file."""

    def children(group, label):
        return {name: child for name, child in group.items() if child.attrs.get("label") == label}

    names, nodes, links = [], [], []
    with h5py.File(path) as file:
        (base,) = children(file, b"CGNSBase_t").values()
        for name, zone in children(base, b"Zone_t").items():
            (coordinates,) = children(zone, b"GridCoordinates_t").values()
            names.append(name)
            nodes.append(np.stack([coordinates[f"Coordinate{axis}"][" data"][()].T for axis in "XYZ"], axis=-1))
            for group in children(zone, b"ZoneGridConnectivity_t").values():
                for link in children(group, b"GridConnectivity1to1_t").values():
                    donor = link[" data"][()].tobytes().decode().strip()
                    ranges = [link[kind][" data"][()].reshape(2, 3) - 1 for kind in ("PointRange", "PointRangeDonor")]
                    links.append((name, ranges[0], donor, ranges[1], link["Transform"][" data"][()].ravel()))
    return names, nodes, links
