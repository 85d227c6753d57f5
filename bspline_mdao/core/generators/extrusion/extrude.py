"""From a multi-block surface grid to a volume grid: hyperbolic extrusion.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from ....base.numerics.progress import Progress, progress_bar
from ....errors import InputError
from ....grids.topology.faces import decompose
from ....grids.topology.grid import Block, Grid, Patch, require_grid
from ....grids.topology.index_space import Window
from ..first_cell import first_cell_of
from .background import with_background
from .layers import layer_heights
from .marching import Conditions, March, Marching, march
from .repeats import Repeats
from .rims import KINDS, Plane, Rim
from .rings import fans_of
from .surface import SurfaceMesh

FAR = 20.0
"""Default outer distance, relative to the longest extent of the surface."""

NEAR = 0.5
"""The same for a grid that ends in a background."""

LAYERS = 64
"""Default number of layers."""

OTHERS = Marching(mitre=1.0), Marching(dissipation=1.3, cycles=200), Marching(dissipation=2.0, cycles=200)
"""Settings to try if cells are inverted otherwise: caps that end in a point at sharp edges need mitres; thin wings on
bodies, and tips as thin as first cells, need smoothing."""


def extrude_surface(
    surface: Grid,
    first_cell: float | None = None,
    layers: int | None = None,
    growth: float | None = None,
    outer: float | None = None,
    symmetry: Sequence[Plane] | None = None,
    constant: Sequence[Plane] = (),
    periodic: Sequence[Plane] = (),
    splay: float = 15.0,
    inward: bool = False,
    *,
    y_plus: float | None = None,
    reynolds: float | None = None,
    length: float | None = None,
    background: float | None = None,
    settings: Marching | None = None,
    allow_invalid: bool = False,
    progress: Progress | bool | None = None,
) -> Grid:
    """Make a volume grid from a multi-block surface grid by hyperbolic extrusion.

    Blocks may have any orientation, meet in nodes with any number of neighbours, close to rings or collapse to poles.
    Their rim may lie in planes of symmetry or be free.

    Parameters
    ----------
    surface : Grid
        Blocks with one node in one direction.
    first_cell : float, optional
        Height of the first cells at the surface (m); or give `y_plus` and `reynolds`.
    layers : int, optional
        Layers of cells; 64 by default, unless ``growth`` is given.
    growth : float, optional
        Height of a layer relative to the layer below it. With ``layers``, the grid ends after so many layers; without,
        it has as many layers as needed.
    outer : float, optional
        Approximate height of all layers (m); by default 20 times the longest extent of the surface, half of this with a
        background.
    symmetry : sequence of ``"x"``, ``"y"``, ``"z"`` or normals of shape (3,), optional
        Planes of symmetry at the rim, by their normals. By default the planes in which the surface ends normally.
        Straight edges lie in many planes, so their planes have to be given.
    constant : sequence of the same, optional
        Planes that edges of the rim stay in, although the surface may not be normal to them.
    periodic : sequence of the same, optional
        Planes that contain edges of the rim at both ends of the surface, which are the same up to a translation from
        end to end, along the normal or oblique to it: their nodes move alike.
    splay : float
        Angle (degrees) by which free edges lean outwards, far from the surface.
    inward : bool
        Extrude to the inside of a closed surface, or below an open one.
    y_plus : float, optional
        Height of the first cells in viscous units instead, estimated from the turbulent boundary layer at the end of a
        flat plate (F. M. White, *Fluid Mechanics*, 7th ed., 2011, section 7.4).
    reynolds : float, optional
        Reynolds number based on `length`, for `y_plus`.
    length : float, optional
        Reference length of the Reynolds number, and length of the plate (m). By default the middle one of the sides of
        the surface's box, the chord of most wings.
    background : float, optional
        Distance from the surface (m) to the sides of a box of cells that is added as the last block. The result is an
        overset grid with its far field at the box. The cells of the box are as wide as the cells that they meet at the
        outer boundary of the other blocks, and grow from there. It ends at planes of symmetry.
    settings : Marching, optional
        Settings of the marching; by default what suits most surfaces, and three other settings if that inverts cells.
    allow_invalid : bool
        Return the grid even if cells are inverted.
    progress : callable or bool, optional
        Called with the fraction done, from 0 to 1, and a text about the current step. By default a terminal shows a
        bar; False turns it off.

    Returns
    -------
    Grid
        A right-handed block for each block of the surface, with k away from it. Patches are ``wall``, ``farfield``,
        ``symmetry`` (``symmetry_2``, ... for further planes), ``constant``, ``periodic`` and ``edges``, the sides of
        free edges, which count as far field. With a background, ``overset`` replaces all but walls and symmetry.

    Raises
    ------
    InputError
        If the surface has branches or cells without area or turns over, if heights do not fit, or cells are inverted.

    References
    ----------
    W. M. Chan and J. L. Steger, *Enhancements of a three-dimensional hyperbolic grid generation scheme*, Applied
    Mathematics and Computation 51 (1992) 181-205.

    Examples
    --------
    >>> from bspline_mdao import Grid
    >>> from bspline_mdao.generators import ball_grid, extrude_surface
    >>> from bspline_mdao.grids import Block
    >>> ball = Grid(tuple(Block(block.nodes[:, :, :1], block.name) for block in ball_grid((9, 9, 9, 3)).blocks))
    >>> grid = extrude_surface(ball, first_cell=1e-3, layers=20, outer=10.0)
    >>> grid.shapes[0], [patch.name for patch in grid.patches]
    ((9, 9, 21), ['wall', 'farfield'])
    """
    require_grid(surface)
    mesh = SurfaceMesh.of(surface, inward)
    if growth is None and layers is None:
        layers = LAYERS
    if outer is None:
        outer = (FAR if background is None else NEAR) * float(np.ptp(mesh.points, axis=0).max())
    height = first_cell_of(plate_length(surface, length, reynolds), first_cell, y_plus, reynolds)
    if height is None:
        raise InputError("extrusion: first cells of no height; give one, or y+ and a Reynolds number")
    steps = layer_heights(height, layers, growth, outer)
    fans = fans_of(mesh, Repeats.none(len(mesh.points)))
    rim = Rim.of(mesh, fans, symmetry, constant, periodic)
    repeats = rim.repeats(mesh)
    rings = rim.rings(fans_of(mesh, repeats), repeats)
    leaning = rim.splay(mesh, fans, repeats, np.deg2rad(splay))
    places, areas = mesh.places
    conditions = Conditions(
        repeats, rings, *rim.constraints(repeats), leaning, mesh.is_side[repeats.first], repeats.unknown[places], areas
    )
    with progress_bar("extruding", progress) as report_progress:
        found = _march(mesh, conditions, steps, settings, allow_invalid, report_progress)
    _require_valid(mesh, found, surface.length_unit, allow_invalid)
    grid = _volume(surface, mesh, rim, found)
    return grid if background is None else with_background(grid, mesh, rim, background)


def plate_length(surface: Grid, length: float | None, reynolds: float | None) -> float:
    """Length of the plate for y+ (m): the given one, or the middle one of the sides of the surface's box."""
    if length is None:
        ends = [[edge(block.nodes.reshape(-1, 3), axis=0) for block in surface.blocks] for edge in (np.min, np.max)]
        return float(np.sort(np.max(ends[1], axis=0) - np.min(ends[0], axis=0))[1])
    if not (np.isfinite(length) and length > 0.0):
        raise InputError(f"extrusion: a length of {length} for the Reynolds number; give a positive one")
    if reynolds is None:
        raise InputError("extrusion: a length, but no Reynolds number; give both or none")
    return length


def _march(
    mesh: SurfaceMesh,
    conditions: Conditions,
    steps: np.ndarray,
    settings: Marching | None,
    allow_invalid: bool,
    progress: Progress,
) -> March:
    """March with given settings, or the first that invert no cell; if all do, with those that get farthest."""
    tries = []
    for each in (settings,) if settings else (Marching(), *OTHERS):
        tries.append(march(mesh, conditions, steps, each, False, progress))
        if tries[-1].is_valid:
            return tries[-1]
    if allow_invalid:
        return march(mesh, conditions, steps, settings or Marching(), True, progress)
    return max(tries, key=lambda found: len(found.corners))


def _require_valid(mesh: SurfaceMesh, found: March, unit: str, allow_invalid: bool) -> None:
    """Refuse inverted cells, or warn of them."""
    bad = np.flatnonzero(~(found.corners > 0.0))
    if not len(bad):
        return
    x, y, z = found.fronts[bad[0], mesh.quads[found.worst[bad[0]]]].mean(axis=0)
    text = (
        f"{mesh.source}: cells are inverted, first in layer {bad[0] + 1} around ({x:.6g}, {y:.6g}, {z:.6g}) {unit}; "
        f"give more layers, a smaller distance or more dissipation, or make the surface smoother there"
    )
    if not (allow_invalid and np.isfinite(found.fronts).all()):
        raise InputError(text)
    warnings.warn(text, stacklevel=3)


def _volume(surface: Grid, mesh: SurfaceMesh, rim: Rim, found: March) -> Grid:
    """The grid from a march, with its patches."""
    blocks: list[Block] = []
    sides: dict[int, list[Window]] = {}
    for number, (block, ids) in enumerate(zip(surface.blocks, mesh.ids)):
        ids = ids.T if mesh.is_turned[number] else ids
        blocks.append(Block(np.ascontiguousarray(np.moveaxis(found.fronts[:, ids], 0, 2)), block.name))
        for label, window in _rim_windows(number, ids, rim, len(found.fronts)):
            sides.setdefault(label, []).append(window)
    whole = [Window.whole(number, block.shape) for number, block in enumerate(blocks)]
    walls = [window for number, ids in enumerate(mesh.ids) for window in _walls(mesh, number, ids.shape)]
    patches = [
        Patch("wall", "wall", tuple(walls)),
        Patch("farfield", "farfield", tuple(window.face(5) for window in whole)),
        *(Patch(*_patch_name(rim, label), tuple(sides[label])) for label in sorted(sides)),
    ]
    return Grid(tuple(blocks), tuple(patches), source=f"{mesh.source}, extruded", unit=surface.unit)


def _walls(mesh: SurfaceMesh, number: int, shape: tuple[int, ...]) -> list[Window]:
    """Windows of the first layer of a block's nodes, without wake sheets."""
    mask = ~mesh.is_sheet[mesh.blocks == number].reshape([n - 1 for n in shape])
    mask = mask.T if mesh.is_turned[number] else mask
    return [Window(number, (*part.lo, 0), (*(n + 1 for n in part.hi), 0)) for part in decompose(mask)]


def _rim_windows(number: int, ids: np.ndarray, rim: Rim, n_fronts: int) -> list[tuple[int, Window]]:
    """Windows of a block's sides at the rim, each with its label, 0 for free edges."""
    windows = []
    for side, nodes in enumerate((ids[0], ids[-1], ids[:, 0], ids[:, -1])):
        labels = rim.kind_of(np.stack([nodes[:-1], nodes[1:]], axis=1))
        labels[nodes[:-1] == nodes[1:]] = -1  # a pole
        cuts = [0, *(np.flatnonzero(np.diff(labels)) + 1).tolist(), len(labels)]
        face = Window.whole(number, (*ids.shape, n_fronts)).face(side)
        for first, last in zip(cuts[:-1], cuts[1:]):
            if labels[first] >= 0:
                lo, hi, along = list(face.lo), list(face.hi), 1 - side // 2
                lo[along], hi[along] = first, last
                windows.append((int(labels[first]), Window(number, tuple(lo), tuple(hi))))
    return windows


def _patch_name(rim: Rim, label: int) -> tuple[str, str]:
    """Name and kind of the patch for a label of the rim."""
    if label == 0:
        return "edges", "farfield"
    kinds = [KINDS[rim.kinds[rim.planes == plane][0]] for plane in range(len(rim.normals))]
    kind = kinds[label - 1]
    place = kinds[:label].count(kind)
    return kind + f"_{place}" * (place > 1), "symmetry" if kind == "symmetry" else "other"
