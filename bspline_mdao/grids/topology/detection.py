"""The topology of a multi-block grid, found from coincident nodes.

Interfaces are windows of faces that lie on the same points in any orientation; declared patches of a known kind are
never part of one. Blocks are cut into *segments*, so that every interface covers whole faces of segments, and the
*links* between segments say which faces, edges and corners coincide. A topology is found once and is valid for every
later shape.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...base.numerics.processes import ONE, on_first, together
from ...base.numerics.vectors import unit_vectors
from ...errors import InputError
from .block_layout import BlockLayout
from .coincidence import SPACING_TOLERANCE, Coincidence, find_coincidence
from .faces import TINY, Face, Rectangle, block_faces, collapsed_windows, decompose, inward_directions
from .grid import Grid, Patch, require_grid
from .index_space import Interface, Window, by_blocks
from .matching import Matches, Meeting, Quads, find_interfaces, find_regions, match_quads
from .periodic import periodic_pairs
from .periodic_interfaces import periodic_interfaces
from .periodic_pair import Motion, PeriodicPair
from .segments import Segmentation, interface_links, junction_links, segment_blocks
from .shell import Shell
from .stored_grid import StoredGrid
from .topology import BoundaryFace, NearMiss, PeriodicLinks, Topology, describe

SMALLEST_SIZE = 1e-100
"""Size of a block (m) whose square is still far above zero in 8-byte reals."""

MAX_WARNINGS = 20
"""Number of warnings kept verbatim; the rest is counted."""


def find_topology(grid: Grid | StoredGrid, comm: Any = ONE) -> Topology:
    """Find the topology of a grid.

    Only the faces of blocks, and the layers of nodes next to them, are used. A grid that is stored in a file is read a
    block at a time; each of several processes reads some blocks, and the first one receives all faces.

    1. Find the points on which the nodes of faces lie (`find_coincidence`).
    2. Match the quads of faces on the same points, separately for declared patches (`match_quads`).
    3. Group them into regions, and complete these where nodes do not quite meet (`Meeting`).
    4. Cut blocks into segments, so that interfaces, patches and collapsed windows cover whole faces (`segment_blocks`);
       repeat this if boundary is found to be periodic, so that both sides are cut in the same way.
    5. Link edges and corners that coincide and are not kept apart (`junction_links`).
    6. All other parts of faces are boundary; describe near misses and suspicious places.

    Parameters
    ----------
    grid : Grid or StoredGrid
        The grid, with its declared patches.
    comm : communicator
        Processes that share the blocks, all of which call this; only this process by default.

    Returns
    -------
    Topology
        The same on all processes.

    Raises
    ------
    InputError
        If a node is not finite, a block has no extent, or a patch does not lie on a face of a block of the grid; on all
        processes.

    Examples
    --------
    >>> from bspline_mdao import find_topology
    >>> from bspline_mdao.generators import brick_grid
    >>> topology = find_topology(brick_grid((5, 5, 5, 5)))
    >>> len(topology.interfaces), topology.n_nodes
    (12, 750)
    """
    shells = _shells(grid, comm)
    return on_first(comm, lambda: _topology_of(grid, shells))


def _shells(grid: Grid | StoredGrid, comm: Any) -> list[Shell]:
    """Faces of all blocks, on the first process; each process takes some of the blocks."""
    with together(comm):
        if not isinstance(grid, StoredGrid):
            require_grid(grid)
        order = sorted(range(len(grid.shapes)), key=lambda block: -math.prod(grid.shapes[block]))
        found = {block: _shell(grid, block) for block in sorted(order[comm.rank :: comm.size])}
    if comm.size > 1:
        found = {block: shell for part in comm.gather(found) or () for block, shell in part.items()}
    return [found[block] for block in sorted(found)]


def _shell(grid: Grid | StoredGrid, block: int) -> Shell:
    """Take the shell of a block; refuse one that is a point or has nodes that are not finite."""
    number = block + 1
    if max(grid.shapes[block]) == 1:
        raise InputError(f"{grid.source}: block {number} is a single node; leave it out")
    nodes = grid.blocks[block].nodes
    if not np.isfinite(nodes).all():
        i, j, k = np.argwhere(~np.isfinite(nodes).all(axis=-1))[0] + 1
        raise InputError(
            f"{grid.source}: block {number} has a node that is not finite at ({i}, {j}, {k}); repair the file"
        )
    shell = Shell.of(nodes)
    if shell.extent < SMALLEST_SIZE:
        raise InputError(f"{grid.source}: all nodes of block {number} are at one point; leave it out")
    return shell


def _topology_of(grid: Grid | StoredGrid, blocks: Sequence[Shell]) -> Topology:
    """Find the topology of a grid from the faces of its blocks."""
    for patch in grid.patches:
        for window in patch.windows:
            _check_patch(grid, patch.name, window)
    coincidence = find_coincidence(blocks)  # step 1
    faces = block_faces(coincidence.ids)
    quads = Quads.of(faces)
    declared = [window for patch in grid.patches for window in patch.windows]
    patch_ids = _patch_ids(faces, grid.patches)
    is_apart = np.array([*(patch.kind != "other" for patch in grid.patches), False])[patch_ids]
    is_closed = quads.is_degenerate | is_apart
    matches = match_quads(quads, is_apart)  # step 2
    meeting = Meeting(faces, quads, ~is_closed, blocks, coincidence)
    regions, doubtful = meeting.complete(find_regions(quads, matches.pairs))  # step 3
    collapsed = collapsed_windows(faces)
    wide = {window: directions for window, directions in collapsed.items() if not _is_strip(window, directions)}
    interfaces = find_interfaces(faces, quads, regions)
    segmentation = segment_blocks(grid.shapes, interfaces, declared, wide)  # step 4
    is_joined = _covered(faces, [side for pair in segmentation.interfaces for side in (pair.a, pair.b)])
    is_closed |= is_joined
    boundary = _boundary(grid.patches, faces, is_joined, is_closed, patch_ids >= 0)
    tied: list[tuple[Motion, list[Interface]]] = []
    for pair in _periodic_pairs(grid, blocks, boundary):
        sides = periodic_interfaces(pair, blocks, faces, coincidence.ids)
        both = [*(side for _, others in tied for side in others), *sides]
        again = segment_blocks(grid.shapes, interfaces, declared, wide, both)
        if sides and again.uncut == segmentation.uncut:
            tied.append((pair.motion, sides))
            segmentation = again
    periodic = tuple(
        PeriodicLinks(motion, tuple(interface_links(grid.shapes, segmentation.segments, sides)))
        for motion, sides in tied
    )
    junctions = junction_links(grid.shapes, segmentation, quads, matches.separated, coincidence.ids)  # step 5
    # step 6
    uncut = [side for item in segmentation.uncut if isinstance(item, Interface) for side in (item.a, item.b)]
    is_reported = is_closed | _covered(faces, uncut)
    near_misses = _near_misses(blocks, coincidence, is_reported, find_interfaces(faces, quads, doubtful))
    joined_gaps = _joined_gaps(blocks, coincidence, segmentation.interfaces)
    repeated = _repeated(coincidence)
    return Topology(
        source=grid.source,
        shapes=grid.shapes,
        interfaces=segmentation.interfaces,
        boundary=boundary,
        collapsed=tuple(collapsed),
        near_misses=near_misses,
        segments=segmentation.segments,
        links=(*segmentation.links, *junctions),
        collapses=segmentation.collapses,
        warnings=_shortened(
            [
                *(f"block {again + 1} repeats block {first + 1}; leave one out" for first, again in repeated),
                *_gap_warnings(near_misses, joined_gaps, grid.length_unit),
                *_warnings(grid, blocks, coincidence, faces, quads, matches, segmentation, patch_ids, is_closed),
            ]
        ),
        joined_gaps=joined_gaps,
        repeated=repeated,
        periodic=periodic,
    )


def _check_patch(grid: Grid | StoredGrid, name: str, window: Window) -> None:
    """Refuse a patch window of a block that does not exist or that is not on a face of its block."""
    if not 0 <= window.block < len(grid.blocks):
        raise InputError(
            f"{grid.source}: patch {name} is on block {window.block + 1}, but the grid has {len(grid.blocks)}; "
            f"correct the patch"
        )
    if not _is_on_face(window, grid.shapes[window.block]):
        raise InputError(
            f"{grid.source}: patch {name}: {describe(window)} is not on a face of the block; correct its ranges"
        )


def _is_on_face(window: Window, shape: Sequence[int]) -> bool:
    """Whether a window lies in a block on one of its faces; unlike `Window.is_on_face`, lines of a face count too."""
    is_inside = all(0 <= lo <= hi < n for lo, hi, n in zip(window.lo, window.hi, shape))
    return is_inside and any(lo == hi and lo in (0, n - 1) for lo, hi, n in zip(window.lo, window.hi, shape))


def _covered(faces: Sequence[Face], windows: Sequence[Window]) -> np.ndarray:
    """Mask of the quads of all faces that lie in one of the windows."""
    masks = [np.zeros(face.n_quads, dtype=bool) for face in faces]
    by_block = by_blocks(windows)
    for face, mask in zip(faces, masks):
        for window in by_block.get(face.window.block, ()):
            mask |= face.covered(window)
    return np.concatenate([mask.ravel() for mask in masks])


def _patch_ids(faces: Sequence[Face], patches: Sequence[Patch]) -> np.ndarray:
    """Return the number of the patch of each quad of all faces, kind other last; -1 for none."""
    ids = [np.full(face.n_quads, -1) for face in faces]
    for number in sorted(range(len(patches)), key=lambda number: patches[number].kind != "other"):
        by_block = by_blocks(patches[number].windows)
        for face, face_ids in zip(faces, ids):
            for window in by_block.get(face.window.block, ()):
                face_ids[face.covered(window)] = number
    return np.concatenate([face_ids.ravel() for face_ids in ids])


def _boundary(
    patches: Sequence[Patch],
    faces: Sequence[Face],
    is_joined: np.ndarray,
    is_closed: np.ndarray,
    is_declared: np.ndarray,
) -> tuple[BoundaryFace, ...]:
    """List declared face windows not covered by interfaces, and rectangles of the remaining boundary."""
    # All masks are over the quads of all faces: part of an interface; that, or collapsed, or of a patch of known kind;
    # part of any patch.
    joined, closed, taken = (_by_face(mask, faces) for mask in (is_joined, is_closed, is_closed | is_declared))
    found = []
    for patch in patches:
        for window in patch.windows:
            there = [number for number, face in enumerate(faces) if face.window.block == window.block]
            covered = {number: faces[number].covered(window) for number in there}
            parts = [window]
            if any((covered[number] & joined[number]).any() for number in there):
                parts = [part for n in there for part in _parts(faces[n], covered[n] & ~closed[n])]
            found += [BoundaryFace(part, patch.name, patch.kind) for part in parts]
    return (*found, *(BoundaryFace(part) for face, mask in zip(faces, taken) for part in _parts(face, ~mask)))


def _periodic_pairs(
    grid: Grid | StoredGrid, blocks: Sequence[Shell], boundary: Sequence[BoundaryFace]
) -> tuple[PeriodicPair, ...]:
    """Pairs of periodic windows: declared in the file, and found where no kind is declared."""
    if not grid.patches:
        return tuple(grid.periodic)  # nothing says what moves, so there is nothing to tie
    bare = [face.window for face in boundary if face.kind in (None, "other")]
    declared = [
        pair for pair in grid.periodic if all(any(w.overlaps(b) for b in bare) for w in (*pair.windows, *pair.others))
    ]
    taken = [window for pair in declared for window in (*pair.windows, *pair.others)]
    left = [window for window in bare if not any(window.overlaps(other) for other in taken)]
    return (*declared, *periodic_pairs(blocks, left, grid.length_unit))


def _by_face(mask: np.ndarray, faces: Sequence[Face]) -> list[np.ndarray]:
    """Split a mask over the quads of all faces into one of shape `Face.n_quads` for each face."""
    return BlockLayout.of(face.n_quads for face in faces).split(mask)


def _parts(face: Face, mask: np.ndarray) -> list[Window]:
    """Cut the marked quads of a face into windows."""
    return [face.part(rectangle) for rectangle in decompose(mask)]


def _near_misses(
    blocks: Sequence[Shell], coincidence: Coincidence, is_taken: np.ndarray, doubtful: Sequence[Interface]
) -> tuple[NearMiss, ...]:
    """Interfaces that a tolerance of near misses would add, after the doubtful ones."""
    faces = block_faces(coincidence.near_ids)
    quads = Quads.of(faces)
    quads.is_degenerate[is_taken | _covered(faces, [side for pair in doubtful for side in (pair.a, pair.b)])] = True
    pairs = match_quads(quads, np.zeros_like(is_taken)).pairs
    found = find_interfaces(faces, quads, find_regions(quads, pairs))
    return tuple(_near_miss(blocks, coincidence, interface) for interface in (*doubtful, *found))


def _near_miss(blocks: Sequence[Shell], coincidence: Coincidence, interface: Interface) -> NearMiss:
    """Measure an interface where its gap is largest relative to the local spacing."""
    gaps, spacing = _gaps(blocks, coincidence, interface)
    worst = np.unravel_index(np.argmax(gaps / spacing), gaps.shape)
    return NearMiss(interface.a, interface.b, float(gaps[worst]), float(spacing[worst]))


def _joined_gaps(
    blocks: Sequence[Shell], coincidence: Coincidence, interfaces: Sequence[Interface]
) -> tuple[NearMiss, ...]:
    """Pick the interfaces with nodes farther apart than round-off and the tolerance of single nodes."""
    found = []
    for interface in interfaces:
        gaps, spacing = _gaps(blocks, coincidence, interface)
        rounding = coincidence.rounding(blocks[interface.a.block].at(interface.a))
        if (gaps > np.maximum(math.sqrt(3.0) * rounding, SPACING_TOLERANCE * spacing)).any():
            found.append(_near_miss(blocks, coincidence, interface))
    return tuple(found)


def _repeated(coincidence: Coincidence) -> tuple[tuple[int, int], ...]:
    """Pairs of blocks whose faces lie on the same points, in any orientation: no two regions have the same surface."""
    found: dict[tuple, int] = {}
    keys = [(*sorted(ids.shape), np.unique(ids.values).tobytes()) for ids in coincidence.ids]
    return tuple((found[key], block) for block, key in enumerate(keys) if found.setdefault(key, block) != block)


def _gaps(blocks: Sequence[Shell], coincidence: Coincidence, interface: Interface) -> tuple[np.ndarray, np.ndarray]:
    """Distances between the nodes of both sides of an interface, and the spacing on the first side (m)."""
    a, b = interface.a, interface.b
    there = interface.orientation.apply(blocks[b.block].at(b))
    gaps = np.linalg.norm(blocks[a.block].at(a) - there, axis=-1)
    return gaps, coincidence.spacing[a.block].at(a)


def _gap_warnings(near_misses: Sequence[NearMiss], joined: Sequence[NearMiss], unit: str) -> list[str]:
    """Say that faces nearly meet, and whether they are joined."""
    lines = []
    if near_misses:
        lines.append(
            f"not joined, though they nearly meet, so that blocks come apart there: "
            f"{_describe_gap(near_misses, 'pairs of faces', unit)}; if they belong together, make their nodes coincide"
        )
    if joined:
        lines.append(
            f"joined, though not all of their nodes coincide: {_describe_gap(joined, 'interfaces', unit)}; a fit gives "
            f"both sides the nodes of the first"
        )
    return lines


def _describe_gap(misses: Sequence[NearMiss], what: str, unit: str) -> str:
    """Count pairs that nearly meet, and describe the worst."""
    worst = max(misses, key=lambda miss: miss.gap / miss.spacing)
    return (
        f"{f'{len(misses)} {what}, the worst ' if len(misses) > 1 else ''}{describe(worst.window)} and "
        f"{describe(worst.other)}, by {worst.gap:.3g} {unit} where cells are {worst.spacing:.3g} {unit}"
    )


def _is_strip(window: Window, directions: tuple[int, ...]) -> bool:
    """Whether a collapsed window is one cell wide: its nodes get equal parameters without being cut out."""
    return any(window.shape[d] == 2 for d in directions)


def _warnings(
    grid: Grid | StoredGrid,
    blocks: Sequence[Shell],
    coincidence: Coincidence,
    faces: Sequence[Face],
    quads: Quads,
    matches: Matches,
    segmentation: Segmentation,
    patch_ids: np.ndarray,
    is_closed: np.ndarray,
) -> list[str]:
    """Say what the topology leaves out and what looks wrong, one line each."""
    ambiguous = [faces[number].window for number in np.unique(quads.face[matches.ambiguous])]
    lines = [*getattr(grid.dialect, "ignored", ())]
    lines += [f"{describe(window)} coincides with two or more others: taken as boundary" for window in ambiguous]
    lines += _contacts(grid.patches, faces, quads, matches.separated, patch_ids)
    lines += _disagreements(grid, blocks, coincidence, faces, quads, matches.pairs, patch_ids, is_closed)
    lines += [
        f"{describe(item.a)} and {describe(item.b)} coincide with the cells of both on the same side: is a block given "
        f"twice, or folded?"
        for item in overlapping(blocks, segmentation.interfaces)
    ]
    for item in segmentation.uncut:
        windows = (item.a, item.b) if isinstance(item, Interface) else (item,)
        lines.append(f"{' and '.join(map(describe, windows))}: not cut out, too many segments")
    return lines


def _shortened(lines: list[str]) -> tuple[str, ...]:
    """Keep the first `MAX_WARNINGS` lines, and count the rest."""
    if len(lines) > MAX_WARNINGS:
        lines[MAX_WARNINGS:] = [f"and {len(lines) - MAX_WARNINGS} more like these"]
    return tuple(lines)


def _contacts(
    patches: Sequence[Patch], faces: Sequence[Face], quads: Quads, pairs: np.ndarray, patch_ids: np.ndarray
) -> list[str]:
    """Say where patches of a known kind lie on another face; two walls are the sides of a plate, as expected."""
    kinds = np.array([*(patch.kind for patch in patches), ""])
    is_plate = (kinds[patch_ids[pairs]] == "wall").all(axis=1)
    lines = []
    for (one, other), (a, b) in _met_windows(faces, quads, pairs[~is_plate], patch_ids):
        if one < 0 or patches[one].kind == "other":
            one, a, b = other, b, a
        patch = patches[one]
        lines.append(
            f"patch '{patch.name}' of kind {patch.kind} on {describe(a)} coincides with {describe(b)}: kept apart; if "
            f"the grid goes on there, take the face out of the patch"
        )
    return lines


def _disagreements(
    grid: Grid | StoredGrid,
    blocks: Sequence[Shell],
    coincidence: Coincidence,
    faces: Sequence[Face],
    quads: Quads,
    pairs: np.ndarray,
    patch_ids: np.ndarray,
    is_closed: np.ndarray,
) -> list[str]:
    """Say where the nodes contradict the connectivity that the file declares, and where they indicate more than it."""
    lines = []
    for item in grid.connections:
        gaps, spacing = _gaps(blocks, coincidence, item)
        is_apart = (gaps > SPACING_TOLERANCE * spacing).any()
        if is_apart and not is_closed[_covered(faces, [item.a])].all():
            lines.append(
                f"the file connects {describe(item.a)} to {describe(item.b)}, whose nodes are up to {gaps.max():.3g} "
                f"{grid.length_unit} apart: taken as boundary; mend the nodes, unless it is periodic"
            )
    if grid.connections:
        is_connected = _covered(faces, [side for item in grid.connections for side in (item.a, item.b)])
        unconnected = pairs[
            is_closed[pairs[:, 0]] & ~is_connected[pairs].any(axis=1) & (patch_ids[pairs] >= 0).any(axis=1)
        ]
        for (one, other), (a, b) in _met_windows(faces, quads, unconnected, patch_ids):
            name = grid.patches[max(one, other)].name
            lines.append(
                f"{describe(a)} and {describe(b)} coincide, but the file does not connect them: taken as an interface; "
                f"if they are the two sides of a plate, make patch '{name}' a wall"
            )
    return lines


def _met_windows(
    faces: Sequence[Face], quads: Quads, pairs: np.ndarray, patch_ids: np.ndarray
) -> Iterator[tuple[tuple[int, int], tuple[Window, Window]]]:
    """Gather pairs of quads by their patches and faces: numbers of both patches, and windows around both sides."""
    labels = np.concatenate([patch_ids[pairs], quads.face[pairs]], axis=1)
    for label in np.unique(labels, axis=0):
        sides = pairs[(labels == label).all(axis=1)].T
        corners = [
            Rectangle((quads.p[side].min(), quads.q[side].min()), (quads.p[side].max(), quads.q[side].max()))
            for side in sides
        ]
        yield tuple(label[:2]), tuple(faces[number].part(corner) for number, corner in zip(label[2:], corners))


def overlapping(
    blocks: Sequence[Shell],  # faces of the blocks of a grid
    interfaces: Sequence[Interface],  # its interfaces; interfaces of blocks one node deep have no sides
) -> Iterator[Interface]:
    """Pick the interfaces most of whose cells lie on the same side of both blocks."""
    for interface in interfaces:
        a, b = interface.a, interface.b
        if min(*blocks[a.block].shape, *blocks[b.block].shape) > 1:
            normals = _normals(blocks[a.block].at(a))
            into_a, into_b = (
                np.expand_dims(inward_directions(blocks[side.block], side), side.shape.index(1)) for side in (a, b)
            )
            heights_a = np.sum(normals * into_a, axis=-1)
            heights_b = np.sum(normals * interface.orientation.apply(into_b), axis=-1)
            if np.mean(heights_a * heights_b > 0.0) > 0.5:
                yield interface


def _normals(face: np.ndarray) -> np.ndarray:
    """Unit normals at the nodes of a face window, from central differences."""
    along = [np.gradient(face, axis=d) for d in range(3) if face.shape[d] > 1]
    normals = np.cross(*along)
    return unit_vectors(normals, np.zeros_like(normals), TINY)
