"""A guess at the kinds of the markers of an unstructured mesh: from the file, their names, and their places.

Words and measures are as in `patch_guess` for structured grids.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...base.display import OneLine
from ..cells.marked_faces import faces_on
from ..cells.mixed_cells import MixedMesh, face_keys
from ..cells.quads import area_vectors
from ..topology.periodic_pair import Motion
from .boundary_planes import OBLIQUE
from .cgns_connections import PERIODIC_TYPE
from .cgns_faces import kind_of
from .cgns_families import BC_OVERSET
from .cgns_overset import OVERSET_TYPE
from .grid_frame import GridFrame
from .marker_pairs import turned_markers
from .patch_certainty import COARSE, FAR, place_of
from .patch_guess import kind_of_name

__all__ = ["MARKER_KINDS", "NO_WALL", "MarkerGuess", "contradicting_guesses", "guess_kinds", "kind_of_words"]

MARKER_KINDS = ("wall", "symmetry", "farfield", "periodic", "inner", "sliding", "other")
"""Kinds of markers: bodies, planes of symmetry, boundaries that fluid passes through, periodic sides, faces inside the
mesh or between its zones, surfaces on which nodes slide, and others."""

PIECE = 1 << 18
"""Faces whose corners are gathered at once: for 10 million cells, all would be 5 gigabytes."""

FLAT = 1e-6
"""Distance of nodes from a plane, relative to the size of a mesh, that counts as rounding of single precision."""

CELLS = "the height of most cells"
"""What the heights of first cells are compared with."""

MOST_PLANES = 6
"""Largest number of planes of a marker: as many as a box has sides."""

NEARLY = 1e-3
"""Largest difference of unit normals of faces of a plane, and of their heights relative to the size of the mesh."""

_KIND_OF_TYPE = {
    "wall": "wall",
    "symmetry": "symmetry",
    "symmetryPlane": "symmetry",
    "empty": "symmetry",
    "wedge": "symmetry",
    "cyclic": "periodic",
    "cyclicAMI": "periodic",
    "cyclicSlip": "periodic",
    "processor": "inner",
    BC_OVERSET: "inner",
    OVERSET_TYPE: "inner",
    PERIODIC_TYPE: "periodic",
}
"""Kinds by OpenFOAM's types of patches, of which ``patch`` says nothing, and by CGNS's further types."""

_WALL_WORDS = """
    wall wing airfoil aerofoil body fuselage blade hub shroud cylinder sphere naca heated isothermal adiabatic flap slat
    nacelle pylon tail fin hull vehicle plate bump rotor stator casing winglet canard aileron rudder elevator spoiler
    strut tip solid
"""
_OTHER_WORDS = {
    "symmetry": "symmetry sym symm symmetric",
    "farfield": "far farfield freestream inlet inflow outlet outflow outer entry exit in out",
    "periodic": "periodic per cyclic",
    "inner": "interface internal interior baffle overset overlap chimera",
}
_KIND_OF_WORD = dict.fromkeys(_WALL_WORDS.split(), "wall") | {
    word: kind for kind, words in _OTHER_WORDS.items() for word in words.split()
}
"""Kinds by words in names, besides the beginnings of names, see `kind_of_name`."""


NO_WALL = "none of its faces", "its name says symmetry", "a plane side"
"""How the reasons begin why a marker is unsure that is no wall to propose: it may be a plane of symmetry."""


@dataclass(frozen=True)
class MarkerGuess(OneLine):
    """The guessed kind of a marker.

    Parameters
    ----------
    kind : str
        One of ``wall``, ``symmetry``, ``farfield``, ``periodic``, ``inner`` or ``other``.
    sure : str
        Certainty: ``sure``, ``likely`` or ``unsure``.
    why : str
        The reason, in words.

    Examples
    --------
    >>> from bspline_mdao.meshes import MarkerGuess
    >>> MarkerGuess("wall", "sure", "by its name").kind
    'wall'
    """

    kind: str
    sure: str
    why: str


def guess_kinds(mesh: MixedMesh, known: Mapping[str, MarkerGuess] | None = None) -> dict[str, MarkerGuess]:
    """Guess the kinds of the markers of a mesh.

    Parameters
    ----------
    mesh : MixedMesh
        The mesh. What its file says about a marker counts first, then whether its faces are inside the mesh, then its
        name, then rotations that map two markers that face each other, and finally places: a planar side in which walls
        end at right angles is symmetry, a marker far from most nodes is a far field, and a near one is a wall unless it
        is a planar side of the mesh.
    known : mapping of str to MarkerGuess, optional
        Markers that are known already, as evidence for the others.

    Returns
    -------
    dict of str to MarkerGuess
        One for each marker, in the order of the mesh.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.meshes import MixedMesh, guess_kinds
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    >>> floor = {"lower_wall": np.array([[0, 1, 2, 2]])}
    >>> guess_kinds(MixedMesh(corners, {"tetra": np.array([[0, 1, 2, 3]])}, floor))["lower_wall"].kind
    'wall'
    """
    places = _Places(mesh)
    found = dict(known or {})
    found |= {n: guess for n in mesh.markers or {} if n not in found and (guess := _by_words(n, places))}
    rest = [name for name in mesh.markers or {} if name not in found]
    for name, (partner, motion) in places.turned(rest).items():
        found[name] = MarkerGuess("periodic", "likely", f"a {motion} maps it onto {partner}")
    rest = [name for name in rest if name not in found]
    for name in rest:
        if not places.is_side(name):
            found[name] = MarkerGuess(*place_of(places.distance(name), places.part(name), CELLS))
    walls = [name for name, guess in found.items() if guess.kind == "wall"]
    for name in rest:
        if name not in found:
            found[name] = _side(name, places, walls)
    return {name: found[name] for name in mesh.markers or {}}


def contradicting_guesses(mesh: MixedMesh, declared: Mapping[str, str]) -> dict[str, MarkerGuess]:
    """Sure guesses at planes of symmetry and far fields that contradict declared kinds; walls may be anything."""
    places = _Places(mesh)
    others = [name for name in declared if ({"symmetry", "farfield"} - {declared[name]}) & {*_said(name, mesh)}]
    guesses = {name: guess for name in others if (guess := _by_words(name, places)) and guess.sure == "sure"}
    return {name: guess for name, guess in guesses.items() if _contradicts(guess, name, declared[name], places)}


def _contradicts(guess: MarkerGuess, name: str, declared: str, places: _Places) -> bool:
    """Whether a sure guess contradicts a declared kind, and no use of that kind is known for such a place."""
    if guess.kind == "symmetry":  # walls on which fluid slips are called symmetry as well
        return declared in ("wall", "farfield") and kind_of_words(name) != "wall" and bool(places.planes(name))
    if guess.kind != "farfield" or not places.is_far(name):
        return False
    if declared == "wall":  # a casing may be called outer
        return "outer" not in name.lower()
    return declared == "symmetry" and len(places.planes(name)) != 1  # nodes of an inlet may slide in its plane


def kind_of_words(name: str) -> str:
    """Kind for the words of a name; ``other`` if they say nothing, or contradict each other."""
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)
    said = {kind for part in parts if (kind := _KIND_OF_WORD.get(part.lower()))}
    said = said or {kind for part in parts if (kind := _KIND_OF_WORD.get(part.lower().rstrip("s")))}
    if len(said) == 1:
        return said.pop()
    return "other" if said else kind_of_name(name)


def _said(name: str, mesh: MixedMesh) -> tuple[str, str]:
    """Kinds by what the file says about a marker, and by its name."""
    stated = (mesh.stated or {}).get(name, "")
    return _KIND_OF_TYPE.get(stated) or kind_of(stated, ""), kind_of_words(name)


def _by_words(name: str, places: _Places) -> MarkerGuess | None:
    """Guess by what the file says, by faces that have cells on both sides, and by the name."""
    of_type, named = _said(name, places.mesh)
    n_outer, n_inner = places.counts(name)
    if not n_outer + n_inner:
        return MarkerGuess("other", "unsure", f"{NO_WALL[0]} is one of a cell")
    if not n_outer and named == "periodic":  # older SU2 files have copies of the cells beyond
        return MarkerGuess("periodic", "likely", "by its name; its faces have cells on both sides")
    if not n_outer:
        is_doubtful = "wall" in (of_type, named)
        why = "its faces have cells on both sides" + ", though it is called a wall" * is_doubtful
        return MarkerGuess("inner", "unsure" if is_doubtful else "sure", why)
    if of_type != "other":
        return MarkerGuess(of_type, "sure", f"its file says {(places.mesh.stated or {})[name]}")
    if named == "other":
        return None
    if named == "symmetry" and not places.planes(name):
        return MarkerGuess("other", "unsure", f"{NO_WALL[1]}, but it is no plane")
    return MarkerGuess(named, "sure" if named in ("wall", "symmetry", "farfield") else "likely", "by its name")


def _side(name: str, places: _Places, walls: list[str]) -> MarkerGuess:
    """Guess at a planar side of the mesh."""
    if not walls:
        return MarkerGuess("other", "unsure", f"{NO_WALL[2]}, and no marker is known to be a wall")
    if any(places.ends_upright(wall, name) for wall in walls):
        return MarkerGuess("symmetry", "likely", f"{NO_WALL[2]} in which a wall ends at a right angle")
    kind, level, reason = place_of(places.distance(name), places.part(name), CELLS)
    if kind == "wall":  # the floor of a tunnel is one, and the side of a box may be anything
        return MarkerGuess("other", "unsure", f"{NO_WALL[2]}, {reason}")
    return MarkerGuess(kind, level, f"{NO_WALL[2]}, {reason}")


class _Places:
    """Places of the markers of a mesh."""

    def __init__(self, mesh: MixedMesh) -> None:
        self.mesh = mesh
        stored = mesh.points[: mesh.n_stored]  # the depth of a layer says nothing
        self.size = float(np.linalg.norm(np.ptp(stored, axis=0))) if len(stored) else 0.0

    @cached_property
    def _frame(self) -> GridFrame:
        return GridFrame.of_points(self.mesh.points[: self.mesh.n_stored])

    @cached_property
    def _faces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Keys of faces at markers, sorted, how often each occurs, heights of cells above, and the usual height."""
        faces, cells = self.mesh.cell_faces
        volumes, areas = self.mesh.quality().volumes, np.empty(len(faces))
        for k in range(0, len(faces), PIECE):
            areas[k : k + PIECE] = np.linalg.norm(area_vectors(self.mesh.points[faces[k : k + PIECE]]), axis=1)
        if self.mesh.n_copies == 2:  # faces in the two planes of a section say nothing about its cells
            is_upper = faces >= self.mesh.n_stored
            areas[is_upper.all(axis=1) | ~is_upper.any(axis=1)] = 0.0
        largest = np.zeros(len(volumes))
        np.maximum.at(largest, cells, areas)
        heights = np.divide(volumes[cells], areas, out=np.zeros_like(areas), where=areas > 0.0)
        usual = np.divide(volumes, largest, out=np.zeros_like(largest), where=largest > 0.0)
        is_marked = np.zeros(self.mesh.n_points, dtype=bool)
        for of_marker in (self.mesh.markers or {}).values():
            is_marked[of_marker] = True
        at = faces_on(faces, is_marked)
        keys, first, counts = np.unique(face_keys(faces[at], self.mesh.n_points), return_index=True, return_counts=True)
        return keys, counts, heights[at[first]], float(np.median(usual)) if len(usual) else 0.0

    def _of(self, name: str) -> np.ndarray:
        return (self.mesh.markers or {})[name]

    def _rows(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Faces of cells that match faces of a marker, and which of its faces these are."""
        keys = self._faces[0]
        wanted = face_keys(self._of(name), self.mesh.n_points)
        rows = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        is_known = keys[rows] == wanted if len(keys) else np.zeros(len(wanted), dtype=bool)
        return rows[is_known], is_known

    def counts(self, name: str) -> tuple[int, int]:
        """Faces of a marker that have a cell on one side, and that have cells on both."""
        n_cells = self._faces[1][self._rows(name)[0]]
        return int((n_cells == 1).sum()), int((n_cells > 1).sum())

    def distance(self, name: str) -> float:
        """Smallest distance of a marker from the middle, relative to the farthest node."""
        return self._frame.distance(self.mesh.points[np.unique(self._of(name) % self.mesh.n_stored)])

    def part(self, name: str) -> float | None:
        """Height of the cells at a marker relative to most cells."""
        rows, usual = self._rows(name)[0], self._faces[3]
        return float(np.median(self._faces[2][rows]) / usual) if len(rows) and usual > 0.0 else None

    def is_far(self, name: str) -> bool:
        """Whether a marker is far from the middle, below cells that are higher than most."""
        part = self.part(name)
        return self.distance(name) > FAR and part is not None and part > COARSE

    def planes(self, name: str) -> list[tuple[np.ndarray, float, float]]:
        """Unit normal of each plane of a marker, and the smallest and largest height along it; none if curved."""
        faces = self._of(name)
        found: list[tuple[np.ndarray, float, float]] = []
        areas, middles = area_vectors(self.mesh.points[faces]), self.mesh.points[faces].mean(axis=1)
        sizes = np.linalg.norm(areas, axis=1)
        while len(faces) and len(found) < MOST_PLANES:
            first = int(np.argmax(sizes))
            if not sizes[first]:
                break
            normal = areas[first] / sizes[first]
            along, off = areas @ normal, (middles - middles[first]) @ normal
            is_near = (np.abs(along) >= (1.0 - NEARLY) * sizes) & (np.abs(off) <= NEARLY * self.size)
            normal = np.sign(along[is_near]) @ areas[is_near]  # faces may face either side
            normal = normal / np.linalg.norm(normal)
            heights = self.mesh.points[faces] @ normal
            level = float(np.median(heights[is_near]))
            is_in = (np.abs(heights - level) <= FLAT * self.size).all(axis=1)
            if not is_in[first]:
                return []
            found.append((normal, float(heights[is_in].min()), float(heights[is_in].max())))
            faces, areas, middles, sizes = faces[~is_in], areas[~is_in], middles[~is_in], sizes[~is_in]
        return [] if len(faces) else found

    def turned(self, names: Sequence[str]) -> dict[str, tuple[str, Motion]]:
        """Markers that a rotation maps onto others, their partners and the rotations; none in a layer of a section."""
        outer = [name for name in names if self.mesh.n_copies == 1 and not self.counts(name)[1]]
        return turned_markers(self.mesh, {name: bool(self.planes(name)) for name in outer})

    def is_side(self, name: str) -> bool:
        """Whether a marker is one plane, with all of the mesh on one side of it."""
        planes = self.planes(name)
        if len(planes) != 1:
            return False
        (normal, low, high), near = planes[0], FLAT * self.size
        heights = self.mesh.points @ normal
        return bool(heights.min() >= low - near or heights.max() <= high + near)

    def ends_upright(self, wall: str, name: str) -> bool:
        """Whether a wall ends in a plane marker, at a right angle."""
        normal, nodes = self.planes(name)[0][0], np.unique(self._of(name))
        faces = self._of(wall)
        areas = area_vectors(self.mesh.points[faces])[np.isin(faces, nodes).any(axis=1)]
        areas = areas[areas.any(axis=1)]
        sines = np.abs(areas @ normal) / np.linalg.norm(areas, axis=1)
        return bool(len(sines) and np.median(sines) < OBLIQUE)
