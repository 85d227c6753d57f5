"""O- and C-grids about named airfoils, with or without layers of flat cells at the wall."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike

import numpy as np

from ...errors import InputError
from ...grids.topology.grid import Block, Grid
from .airfoil import Airfoil
from .airfoil_file import airfoil
from .first_cell import first_cell_of
from .section_c_grid import section_c_grid
from .section_o_grid import section_o_grid

__all__ = ["BASES", "TOPOLOGIES", "airfoil_grid", "unit_of"]

TOPOLOGIES = "O", "C"
"""Around the airfoil, or around it and along its wake."""

BASES = "wall", "closed"
"""Treatments of a blunt trailing edge."""

GROWTH = 1.15
"""Growth of the heights of cells from the wall outward, if first cells are low and their number is not given."""

FAR = 50.0
"""Default radius of the outer boundary in chords: a lift of 0.5 changes the angle there by a tenth of a degree."""

N_AROUND, N_AWAY = 128, 48
"""Default cells around and away: a flow takes seconds."""

SQUARE = 0.5
"""Default height of the first cells, relative to the chord over the cells around: the cells of a conformal grid grow
threefold at a sharp trailing edge, where splines then fold."""

_AS_IT_IS = 0.01
"""Fraction of the chord by which nose and trailing edge may be off (0, 0) and (1, 0) in a file of unit chord."""


def airfoil_grid(
    of: str | PathLike | Airfoil,
    n_around: int = N_AROUND,
    n_away: int | None = None,
    *,
    far: float = FAR,
    chord: float = 1.0,
    first_cell: float | None = None,
    y_plus: float | None = None,
    reynolds: float | None = None,
    topology: str = "O",
    n_wake: int | None = None,
    base: str | None = None,
) -> Grid:
    """Make the O- or C-grid about an airfoil, one cell deep between two planes of symmetry.

    Parameters
    ----------
    of : str, path-like or Airfoil
        The airfoil, or its name for `airfoil`: NACA digits, coefficients or a file.
    n_around : int
        Cells around the airfoil, an even number of 8 or more.
    n_away : int, optional
        Cells from the airfoil to the outer boundary; 48 by default, or with a given height of the first cells as many
        as a growth of 15 % from it takes.
    far : float
        Radius of the outer boundary in chords. For a C-grid it is the distance upstream and along the wake; above and
        below it is twice as far.
    chord : float
        Length of the chord (m), which is 1 in a file of unit chord. Other files are scaled, and moved so that the nose
        is at (0, 0); none is rotated.
    first_cell : float, optional
        Height of the first cells (m), for boundary layers; by default half of the chord divided by the cells around.
    y_plus : float, optional
        Height of the first cells in viscous units instead, estimated from the turbulent boundary layer at the end of a
        flat plate of this chord (F. M. White, *Fluid Mechanics*, 7th ed., 2011, section 7.4).
    reynolds : float, optional
        Chord Reynolds number, for `y_plus`.
    topology : str
        ``"O"``: around the airfoil; ``"C"``: around it and along a cut behind it, which leaves the trailing edge along
        the bisector of its corner. First cells at the cut become higher behind the trailing edge.
    n_wake : int, optional
        Cells along the cut of a C-grid; by default as many as a growth of 15 % from the wall's cells takes.
    base : str, optional
        Treatment of a blunt trailing edge. ``"wall"`` keeps its base as a wall with a block behind it, the default of
        C-grids; on request also for NACA sections, whose definition is blunt. ``"closed"`` removes a wedge from the
        thickness, see `Airfoil.section`, the default of O-grids.

    Returns
    -------
    Grid
        Right-handed blocks one chord deep, with the patches ``airfoil``, ``farfield`` and ``symmetry``. The airfoil is
        in the plane of x and y. An O-grid is one block of ``n_around + 1``, ``n_away + 1`` and 2 nodes; i runs from the
        trailing edge along the lower side to the nose and back along the upper side. A C-grid has such a block between
        a block below and a block above the cut, whose i runs to and from the trailing edge, and a fourth one behind a
        base. The base is a separate patch, ``base``.

    Raises
    ------
    InputError
        If there is no such airfoil, or no such grid.

    Examples
    --------
    >>> from bspline_mdao.generators import airfoil_grid
    >>> airfoil_grid("naca2412", 32, far=20.0).shapes
    ((33, 49, 2),)
    >>> airfoil_grid("naca2412", 32, far=20.0, y_plus=1.0, reynolds=6e6).shapes
    ((33, 98, 2),)
    >>> airfoil_grid("naca2412", 32, far=20.0, topology="C", n_wake=24).shapes
    ((25, 49, 2), (33, 49, 2), (25, 49, 2))
    """
    section = of if isinstance(of, Airfoil) else airfoil(of, blunt=base == "wall")
    if not chord > 0.0:
        raise InputError(f"airfoil grid: a chord of {chord:g} m; give a positive length")
    if topology not in TOPOLOGIES:
        raise InputError(f"airfoil grid: topology '{topology}'; give one of {', '.join(TOPOLOGIES)}")
    if n_wake is not None and topology != "C":
        raise InputError(f"airfoil grid: {n_wake} cells along a wake, which a C-grid has; give topology 'C' as well")
    if base not in (None, *BASES) or (base == "wall" and topology != "C"):
        raise InputError(f"airfoil grid: base '{base}' of {topology}-grids; give 'closed', or 'wall' and topology 'C'")
    if base == "wall" and not section.base:
        raise InputError(f"airfoil '{section.name}': its trailing edge is sharp, and has no base that is a wall")
    height = first_cell_of(chord, first_cell, y_plus, reynolds)
    rows = n_away or (N_AWAY if height is None else _rows(height / chord, far))
    off_wall = SQUARE / max(n_around, 1) if height is None else height / chord
    try:
        if topology == "C":
            kept = 0.0 if base == "closed" else section.base_of_section
            grid = section_c_grid(section.section, n_around, far, rows, off_wall, n_wake, kept)
        else:
            grid = section_o_grid(section.section, n_around, far, rows, off_wall)
    except InputError as error:
        raise InputError(f"airfoil '{section.name}': {error}") from error
    unit, origin = unit_of(section)
    blocks = []
    for block in grid.blocks:
        plane = (section.place(block.nodes[..., :2]) - origin) * (chord / unit)
        nodes = np.concatenate([plane, chord * block.nodes[..., 2:]], axis=-1)
        blocks.append(Block(nodes, block.name.replace("section", "airfoil")))
    patches = tuple(replace(patch, name=patch.name.replace("wing", "airfoil")) for patch in grid.patches)
    return Grid(tuple(blocks), patches, source=f"{topology}-grid about {section.name}")


def unit_of(section: Airfoil) -> tuple[float, np.ndarray]:
    """Length of a chord in the coordinates of an outline, and the place of their origin, shape (2,)."""
    off = np.abs([section.nose, section.tail - [1.0, 0.0]]).max()
    return (1.0, np.zeros(2)) if off < _AS_IT_IS else (section.chord, section.nose)


def _rows(
    height: float,  # of the first cells (chords)
    far: float,  # radius of the outer boundary (chords)
) -> int:
    """Count cells that grow from the wall to the outer boundary."""
    return max(4, int(np.ceil(np.log1p((GROWTH - 1.0) * far / height) / np.log(GROWTH))))
