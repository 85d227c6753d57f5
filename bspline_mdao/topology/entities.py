"""What a topology consists of: interfaces, boundary faces, near misses, links and collapses."""

from __future__ import annotations

from dataclasses import dataclass

from .index_space import Orientation, Window

Section = tuple[int | None, int | None, int | None]
"""A face, an edge or a corner of a segment: per direction 0 (low end), -1 (high end) or None (all)."""


@dataclass(frozen=True)
class Interface:
    """Two face windows whose nodes coincide one to one.

    Parameters
    ----------
    a, b : Window
        Face windows of grid blocks; both may lie in one block (O and C grids), even in one face (a fold).
    orientation : Orientation
        Carries the directions of a's block to those of b's, the flat one to the flat one, backwards where leaving
        block a means entering block b against its index.
    """

    a: Window
    b: Window
    orientation: Orientation


@dataclass(frozen=True)
class BoundaryFace:
    """A face window that no block continues.

    Parameters
    ----------
    window : Window
        The face window of a grid block.
    patch, kind : str or None
        Name and kind of the declared patch that it belongs to; None where nothing is declared.
    """

    window: Window
    patch: str | None = None
    kind: str | None = None


@dataclass(frozen=True)
class NearMiss:
    """Two face windows that nearly coincide and are therefore probably meant to, whether they are joined or not.

    Parameters
    ----------
    window : Window
        The face window.
    other : Window or None
        The one it nearly meets.
    gap : float
        Distance of two nodes that nearly coincide, in metres, where it is largest by the local spacing.
    spacing : float
        Local spacing there, in metres.
    """

    window: Window
    other: Window | None
    gap: float
    spacing: float


@dataclass(frozen=True)
class Link:
    """Two sections of segments that are one and the same.

    Parameters
    ----------
    a, b : int
        Segment numbers.
    a_section, b_section : tuple of (int or None)
        Sections (see `Section`), for example ``(0, None, None)``; faces, edges or corners.
    orientation : Orientation
        Carries the directions of segment a to those of segment b.
    """

    a: int
    a_section: Section
    b: int
    b_section: Section
    orientation: Orientation


@dataclass(frozen=True)
class Collapse:
    """A section of a segment in which all points along one direction are one.

    Parameters
    ----------
    segment : int
        Segment number.
    section : tuple of (int or None)
        The face or edge (see `Section`).
    direction : int
        The direction of zero extent.
    """

    segment: int
    section: Section
    direction: int
