"""What is proved about the validity of a grid, block by block, and the proof for its cells.

Theory: ``docs/theory/validity.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...base.numerics.processes import from_all, together
from ...base.numerics.threads import run_tasks, thread_count
from ...base.text import counted
from .bernstein import INVALID, MAX_HALVINGS, UNDECIDED, VALID
from .block_cells import BlockCells, Chunk
from .cell_loops import as_points
from .grid_quality import GridQuality
from .hexahedron import mean_normal
from .jacobian_bounds import block_bounds, decide_cells

__all__ = ["BlockCertificate", "Certificate", "certify_cells", "joined", "of_statuses"]

STATUSES = {VALID: "valid", UNDECIDED: "undecided", INVALID: "invalid"}

MOST_NAMED = 5
"""Largest number of places to name per block."""

IN_CELLS, IN_SPLINES = "everywhere in them, not only at corners", "everywhere between neighbouring knots"
"""Where the Jacobians of valid cells, and of valid elements of splines, are positive."""


@dataclass(frozen=True)
class BlockCertificate(OneLine):
    """What is proved about the cells, or the elements of the spline, of one block."""

    block: str  # name of the block
    what: str  # what is counted
    n: int  # their number
    # how many are proved invalid, and how many are undecided
    n_invalid: int
    n_undecided: int
    # some of these, i, j, k or one number, from 1, and what is known; the invalid ones first
    places: tuple[tuple[int | str, ...], ...]

    @property
    def status(self) -> str:
        """``"valid"`` if all are, ``"invalid"`` if at least one is not, ``"undecided"`` otherwise."""
        return "invalid" if self.n_invalid else "undecided" if self.n_undecided else "valid"

    def __str__(self) -> str:
        if self.status == "valid":
            return f"{self.block}: all of {counted(self.n, self.what)} valid"
        counts = [
            f"{n:,} {status}" for n, status in ((self.n_invalid, "invalid"), (self.n_undecided, "undecided")) if n
        ]
        places = ", ".join(f"({', '.join(map(str, index))}) {status}" for *index, status in self.places)
        return f"{self.block}: {' and '.join(counts)} of {counted(self.n, self.what)}, such as {places}"


@dataclass(frozen=True)
class Certificate(OneLine):
    """What is proved about a grid: about the trilinear maps of its cells, and its splines if it has some."""

    cells: tuple[BlockCertificate, ...]  # one for each block that has cells
    splines: tuple[BlockCertificate, ...] = ()  # one for each volume of a fitted model; empty for a plain grid

    @property
    def status(self) -> str:
        """``"valid"`` if all blocks are, ``"invalid"`` if at least one is not, ``"undecided"`` otherwise."""
        found = {part.status for part in (*self.cells, *self.splines)}
        return "invalid" if "invalid" in found else "undecided" if "undecided" in found else "valid"

    @property
    def is_valid(self) -> bool:
        """Whether everything is proved valid."""
        return self.status == "valid"

    def __repr__(self) -> str:
        parts = [_summary(parts) for parts in (self.cells, self.splines) if parts]
        return f"Certificate({self.status}: {'; '.join(parts)})"

    def lines(self) -> list[str]:
        """Summarise, and name what is not valid, block by block."""
        lines = []
        for parts, where in ((self.cells, IN_CELLS), (self.splines, IN_SPLINES)):
            if parts:
                lines.append(_summary(parts, f": their Jacobian is proved positive {where}"))
                lines += [f"  {part}" for part in parts if part.status != "valid"]
        return lines


def _summary(parts: tuple[BlockCertificate, ...], meaning: str = "") -> str:
    """Count what is valid, and say what that means; count what is invalid and undecided."""
    n, n_invalid, n_undecided = (sum(getattr(p, name) for p in parts) for name in ("n", "n_invalid", "n_undecided"))
    if n_invalid + n_undecided == 0:
        return f"all {counted(n, parts[0].what)} valid{meaning}"
    n_valid = n - n_invalid - n_undecided
    found = f"{n_valid:,} of {counted(n, parts[0].what)} valid{meaning}"
    return f"{found}; {n_invalid:,} invalid, {n_undecided:,} undecided"


def of_statuses(
    # see `BlockCertificate`
    block: str,
    what: str,
    status: np.ndarray,  # uint8 (n_i, n_j, n_k), status of each; or (n,)
    offset: tuple[int, ...] = (0, 0, 0),  # number, from 0, of the first
) -> BlockCertificate:
    """Summarise the statuses of a block."""
    n_invalid, n_undecided = (int(np.count_nonzero(status == value)) for value in (INVALID, UNDECIDED))
    places: list[tuple[int | str, ...]] = []
    for value in (INVALID, UNDECIDED):
        ids = np.flatnonzero(status == value)[: MOST_NAMED - len(places)]
        for index in zip(*np.unravel_index(ids, status.shape)):
            places.append((*(int(at) + first + 1 for at, first in zip(index, offset)), STATUSES[value]))
    return BlockCertificate(block, what, status.size, n_invalid, n_undecided, tuple(places))


def joined(parts: Iterable[BlockCertificate]) -> BlockCertificate:
    """Join what is known about the pieces of one block."""
    parts = list(parts)
    places = sorted((place for part in parts for place in part.places), key=lambda p: (p[-1] != "invalid", p[:-1]))
    n, n_invalid, n_undecided = (sum(getattr(p, name) for p in parts) for name in ("n", "n_invalid", "n_undecided"))
    first = parts[0]
    return BlockCertificate(first.block, first.what, n, n_invalid, n_undecided, tuple(places[:MOST_NAMED]))


def certify_cells(
    quality: GridQuality,  # the cells, and what the baseline decided about them; all processes call it
    nodes: np.ndarray,  # (n_nodes, 3), nodes of this process (m)
    max_halvings: int = MAX_HALVINGS,  # see `bspline_mdao.grids.cells.bernstein.decide`
) -> tuple[BlockCertificate, ...]:  # one for each block of the grid that has cells
    """Prove which cells are valid: cells whose trilinear maps have a positive Jacobian everywhere inside."""
    local, pieces = [], quality.pieces
    normals = quality.normals(nodes)
    with together(pieces.comm):
        for block in quality.blocks:
            status = statuses_of(block, nodes, normals.get(block.window.block), max_halvings, quality.n_threads)
            part = of_statuses(block.name, "cell", status, block.window.lo)
            local.append((block.window.block, block.window.lo, part))
    found: dict[int, list] = {}
    for number, _, part in sorted(
        (entry for parts in from_all(pieces.comm, local) for entry in parts), key=lambda e: e[:2]
    ):
        found.setdefault(number, []).append(part)
    return tuple(joined(parts) for parts in found.values())


def statuses_of(
    block: BlockCells,
    nodes: np.ndarray,
    normal: np.ndarray | None = None,
    max_halvings: int = MAX_HALVINGS,
    n_threads: int | None = None,
) -> np.ndarray:
    """Statuses of the cells of a block of a grid with nodes (n_nodes, 3), in the shape of its cells."""
    # ``normal`` belongs to a planar block as it is now; its mean normal by default.
    status = np.empty(block.n_cells, dtype=np.uint8)
    if block.flat is not None and normal is None:
        normal = mean_normal(np.moveaxis(block.nodes_of(nodes), block.flat, 2)[:, :, 0])

    def decide_chunk(chunk: Chunk) -> None:
        _decide(chunk, nodes, normal, max_halvings, status[chunk.in_block])

    run_tasks(decide_chunk, list(block.chunks()), thread_count(n_threads))
    in_block = status.reshape(block.degenerate_corners.shape)
    return in_block if block.flat is None else np.moveaxis(in_block, 2, block.flat)


def _decide(chunk: Chunk, nodes: np.ndarray, normal: np.ndarray | None, max_halvings: int, status: np.ndarray) -> None:
    """Write the statuses of the cells of a chunk."""
    block = chunk.block
    points, bounds = as_points(chunk.solid(nodes, normal)), np.empty((3, status.size))
    bits = chunk.solid_bits
    sign = float(block.handedness)
    block_bounds(points, bits, sign, *bounds)
    decide_cells(points, bits, sign, block.shortest, *bounds, max_halvings, status)
