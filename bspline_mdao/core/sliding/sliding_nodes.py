"""Nodes of patches that slide on fixed surfaces: their final positions, from where control points take them.

A node stays as far from its surfaces as it is on the baseline: it is on them, up to the digits of the file or of a
given radius. So nothing moves at rest. A node of several surfaces, such as a casing and a plane of symmetry that ends
on it, stays on all of them.

Theory: ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.display import OneLine
from ...grids.topology.node_numbering import node_copies, source_rows
from ...grids.topology.sharing import boundary_sections
from ...grids.topology.topology import Topology
from .closest import closest_on
from .fixed_surface import FixedSurface, Plane

__all__ = ["SlidNodes", "Slide", "SlidingGroup", "SlidingNodes"]

INDEPENDENT = 1e-3
"""A surface counts if its normal differs from the normals of the node's others by more than this (rad)."""


@dataclass(frozen=True, eq=False)
class Slide(OneLine):
    """Sides of segments whose nodes slide on one surface."""

    what: str  # the patch, for messages
    surface: FixedSurface
    sides: tuple[int, ...] = ()  # their numbers in `bspline_mdao.grids.topology.sharing.boundary_sides`


@dataclass(frozen=True, eq=False)
class SlidingGroup(OneLine):
    """Nodes that slide on the same surfaces."""

    what: str  # for messages
    surfaces: tuple[FixedSurface, ...]
    places: np.ndarray  # (m,) of int, numbers among the sliding nodes
    heights: np.ndarray  # (n_surfaces, m), values of the functions of the surfaces on the baseline (m)


@dataclass(frozen=True, eq=False)
class SlidingNodes(OneLine):
    """Nodes that slide on surfaces that are not planes. Made by `SlidingNodes.of`."""

    rows: np.ndarray  # (n,) of int, their rows in the grid vector, each shared node once, ascending
    groups: tuple[SlidingGroup, ...]
    places: np.ndarray  # (n,) of int, their numbers among the nodes that are given, see `among`

    @classmethod
    def of(
        cls,
        topology: Topology,
        nodes: np.ndarray,  # (n_nodes, 3), the baseline (m)
        slides: Sequence[Slide],  # the curved ones, and planes that their nodes also stay in
    ) -> SlidingNodes:
        """Find the surfaces of every node."""
        numbers, copies = topology.layout.numbers, node_copies(topology)
        rows_of_segments = [numbers[segment.block][segment.slices] for segment in topology.segments]
        sides = [source_rows(copies, rows.ravel()) for _, rows in boundary_sections(topology, rows_of_segments)]
        return cls.of_members(slides, [np.concatenate([sides[n] for n in slide.sides]) for slide in slides], nodes)

    @classmethod
    def of_members(
        cls,
        slides: Sequence[Slide],  # the curved ones, and planes that their nodes also stay in
        members: Sequence[np.ndarray],  # of int, nodes of each by their rows
        nodes: np.ndarray,  # (n_nodes, 3), the baseline (m)
    ) -> SlidingNodes:
        """Find the surfaces of every node that is on a curved one."""
        curved = [rows for slide, rows in zip(slides, members) if not isinstance(slide.surface, Plane)]
        rows = np.unique(np.concatenate(curved))
        is_on = _independent(slides, nodes[rows], np.array([np.isin(rows, of_slide) for of_slide in members]))
        patterns, which = np.unique(is_on, axis=1, return_inverse=True)
        groups = []
        for number, pattern in enumerate(patterns.T):
            chosen = [slide for slide, counts in zip(slides, pattern) if counts]
            places = np.flatnonzero(which.ravel() == number)
            heights = np.array([slide.surface.levels(nodes[rows[places]]).values for slide in chosen])
            groups.append(SlidingGroup(chosen[0].what, tuple(slide.surface for slide in chosen), places, heights))
        return cls(rows, tuple(groups), np.arange(len(rows)))

    def off(self, nodes: np.ndarray) -> float:
        """Largest distance (m) of nodes of a grid, shape (n_nodes, 3), from where they slide."""
        points = nodes[self.rows]
        heights = [
            (surface.levels(points[group.places]), height)
            for group in self.groups
            for surface, height in zip(group.surfaces, group.heights)
        ]
        return max(
            float((np.abs(at.values - height) / np.linalg.norm(at.gradients, axis=1)).max(initial=0.0))
            for at, height in heights
        )

    def among(self, rows: np.ndarray) -> SlidingNodes:
        """The same nodes, numbered among nodes given by their rows, (m,) of int."""
        order = np.argsort(rows)
        return replace(self, places=order[np.searchsorted(rows, self.rows, sorter=order)])

    def at(self, asked: np.ndarray) -> SlidNodes:
        """Positions of the nodes, shape (n, 3), from the requested ones of these and others, shape (m, 3) (m)."""
        return self._at(asked[self.places], [(group.heights, None) for group in self.groups])

    def from_baseline(self, asked: np.ndarray, baseline: np.ndarray) -> SlidNodes:
        """As `at`, with another baseline, shape (m, 3) (m), which sets the heights above the surfaces."""
        at_rest = baseline[self.places]
        heights = []
        for group in self.groups:
            levels = [surface.levels(at_rest[group.places]) for surface in group.surfaces]
            values, gradients, _ = zip(*levels)
            heights.append((np.array(values), np.stack(gradients, axis=1)))
        return self._at(asked[self.places], heights)

    def _at(self, points: np.ndarray, heights: Sequence[tuple[np.ndarray, np.ndarray | None]]) -> SlidNodes:
        """Nodes of every group at its heights, (n_surfaces, m), and these heights' derivatives in the baseline."""
        found, matrices = np.empty_like(points), np.empty((2, len(points), 3, 3), points.dtype)
        for group, (of_group, by_baseline) in zip(self.groups, heights):
            closest = closest_on(group.surfaces, points[group.places], of_group, group.what)
            found[group.places], matrices[0, group.places] = closest.points, closest.jacobians
            matrices[1, group.places] = 0.0 if by_baseline is None else closest.by_heights @ by_baseline
        return SlidNodes(found, *matrices)


@dataclass(frozen=True, eq=False)
class SlidNodes(OneLine):
    """Positions of nodes after sliding, with derivatives."""

    points: np.ndarray  # (n, 3), in metres
    jacobians: np.ndarray  # (n, 3, 3), with respect to the requested positions; symmetric
    by_baseline: np.ndarray  # (n, 3, 3), with respect to the baseline, through the heights; zero if it is fixed

    def jvp(self, change: np.ndarray) -> np.ndarray:
        """Change of the nodes with a change of the requested positions, both of shape (n, 3)."""
        return np.einsum("nij,nj->ni", self.jacobians, change)

    vjp = jvp

    def baseline_jvp(self, change: np.ndarray) -> np.ndarray:
        """Change of the nodes with a change of the baseline, both of shape (n, 3)."""
        return np.einsum("nij,nj->ni", self.by_baseline, change)

    def baseline_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `baseline_jvp`."""
        return np.einsum("nij,ni->nj", self.by_baseline, bar)


def _independent(slides: Sequence[Slide], points: np.ndarray, is_on: np.ndarray) -> np.ndarray:
    """Which surfaces of every node count, (n_slides, n): those whose normal none of its others has."""
    kept, basis = np.zeros_like(is_on), np.zeros((len(points), 3, 3))
    counts = np.zeros(len(points), dtype=int)
    for number in sorted(range(len(slides)), key=lambda n: isinstance(slides[n].surface, Plane)):
        places = np.flatnonzero(is_on[number] & (counts < 3))
        normals = slides[number].surface.levels(points[places]).gradients
        normals = normals / np.linalg.norm(normals, axis=1)[:, None]
        left = normals - np.einsum("nij,nik,nk->nj", basis[places], basis[places], normals)
        length = np.linalg.norm(left, axis=1)
        is_new = length > INDEPENDENT
        new = places[is_new]
        basis[new, counts[new]] = left[is_new] / length[is_new, None]
        counts[new] += 1
        kept[number, new] = True
    return kept
