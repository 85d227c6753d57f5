"""Named deformations, from text such as ``twist=30deg+bend=120deg@0.7`` or a file of points.

They are used by the command line and the robustness studies. The text has the form ``name=value@place,key=value``;
angles are in degrees there and in radians in the maps. Commas within brackets do not separate:
``rotate=25deg@hinge(0.7,0,0 -> 0.7,0,3),blend=0.05``. Theory: ``docs/theory/deformations.rst``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...errors import InputError
from ..cad.tied_surface import body_of_file, require_on_faces
from ..measures.edge_cuts import cut_edges, edges_of_quads
from ..mesh.control_net import surface_quads
from ..mesh.frame import Frame, Plane, mesh_planes, surface_frame
from ..mesh.moving_mesh import MovingMesh
from ..mesh.surface import SurfaceGrid
from .axisymmetric import ScaleRadius, StretchAlong
from .cad_deformation import CadDeformation
from .deformation import (
    Bend,
    Deformation,
    Pitch,
    PointMap,
    PrescribedPoints,
    Rotate,
    RotateSections,
    ScaleChord,
    ScaleThickness,
    ShearDownstream,
    ShearUpwards,
    Stretch,
    Translate,
    apply_maps,
    random_bumps,
)
from .hinge import ON_LINE, BehindHinge, Hinge, NearestPart, RotatedPart
from .lattice_deformation import LatticeDeformation, moved_lattice
from .selection import OnPatch, designed_patches

__all__ = [
    "DEFORMATIONS",
    "SUFFIXES",
    "Request",
    "parse_deformation",
    "parse_requests",
    "read_points",
]

SUFFIXES = (".csv", ".dat", ".npy", ".txt")
"""Suffixes of files of points: NumPy's, and text with three numbers per line, separated by commas or blanks."""

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
"""Pattern of a number in words."""

_POINT = rf"\s*({_NUMBER})\s*,\s*({_NUMBER})\s*,\s*({_NUMBER})\s*"
"""Pattern of a point in words."""

_STEEPEST = 1.5
"""Largest slope of the fading of a blend, times its length."""

_INBOARD = 0.1
"""Fraction of the span inboard of an arc from which points count towards the surface thickness on it, which may have no
points of its own."""


class HasWallSpacing(Protocol):
    """A model of a grid or a mesh."""

    def wall_spacing(self) -> float:
        """Median height of the cells at its walls (m)."""


def parse_deformation(spec: str | Sequence[str], model: HasWallSpacing, mesh: MovingMesh) -> Deformation:
    """Make a deformation from text such as ``twist=5deg``.

    Parameters
    ----------
    spec : str or sequence of str
        Deformations joined by ``+``, applied one after the other; a sequence is joined as well. Each is a name from
        `DEFORMATIONS` with its value, ``bend=120deg@0.7``, or a file of new surface points (``.csv``, ``.dat``,
        ``.npy``, ``.txt``) in the order of ``mesh.surface_ids``.
    model : FittedModel or MeshModel
        The fitted grid or mesh, whose ``wall_spacing()`` gives lengths in cells.
    mesh : MovingMesh
        The control mesh of the model (`moving_mesh`), whose surface is deformed.

    Returns
    -------
    Deformation
        Lengths, spans and directions are measured on the surface as left by the preceding deformations.

    Raises
    ------
    InputError
        If the text is not understood, or a file is invalid.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> from bspline_mdao.core.mesh.boundary import moving_mesh
    >>> model = fit_grid(flat_plate_grid((9, 9, 9)), n_control=(5, 5, 5))
    >>> mesh = moving_mesh(model)
    >>> deformation = parse_deformation("stretch=2+bend=120deg@0.7", model, mesh)
    >>> points = deformation.apply(mesh.points[mesh.surface_ids])
    """
    texts = [spec] if isinstance(spec, str) else list(spec)
    if not any(text.strip() for text in texts):
        raise InputError(f"deformation: nothing is asked for; the names are {', '.join(DEFORMATIONS)}")
    surface, maps = _Surface(model, mesh, mesh.points[mesh.surface_ids], mesh_planes(mesh)), []
    for request in [request for text in texts for request in _requests(text)]:
        maps.append(_make(request, surface))
        surface = replace(surface, points=maps[-1].apply(surface.points), before=tuple(maps))
    return Deformation(mesh, tuple(maps))


@dataclass(frozen=True, eq=False)
class _Surface:
    """The surface as left by earlier deformations, on which lengths and directions are measured."""

    model: Any
    mesh: MovingMesh
    points: np.ndarray  # (n_surface, 3), control points (m)
    planes: tuple[Plane, ...]
    before: tuple[PointMap, ...] = ()  # the deformations before

    @cached_property
    def frame(self) -> Frame:
        return surface_frame(self.points, self.planes)

    def part(self, patches: Sequence[str]) -> NearestPart:
        """Patches by name or pattern, represented by control points and nodes."""
        is_part = OnPatch(self.model, patches).mask(self.mesh)
        walls = SurfaceGrid.of(self.model)
        of_nodes = np.zeros(walls.n_points, dtype=bool)
        for number in walls.part(patches):
            of_nodes[walls.parts[number]] = True
        points = np.concatenate([self.mesh.points[self.mesh.surface_ids], walls.points])
        known = NearestPart.of(points, np.concatenate([is_part, of_nodes]))
        return known.moved(lambda points: apply_maps(self.before, points))

    def line(self, chord: float, span: tuple[float, float]) -> np.ndarray:
        """Points at a chord fraction and two span fractions, shape (2, 3); positive angles rotate the rear down."""
        points = self.mesh.points.copy()
        points[self.mesh.surface_ids] = self.points
        return Hinge.on_chord(replace(self.mesh, points=points), chord, span).points


def read_points(
    # ``.npy``: shape (n, 3), or (3 n,) with xyz interleaved. ``.csv``, ``.dat``, ``.txt``: three numbers per line,
    # separated by commas or blanks; a heading and lines that begin with ``#`` are skipped
    path: Path,  # path-like
    n_points: int,  # expected number of points
) -> np.ndarray:  # (n_points, 3)
    """Read points from a file."""
    path = Path(path)
    try:
        values = np.load(path, allow_pickle=False) if path.suffix == ".npy" else _read_text(path)
        values = np.asarray(values, dtype=np.float64)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); check the name") from None
    except (ValueError, TypeError, EOFError) as error:
        raise InputError(
            f"{path}: not a list of points ({str(error).splitlines()[0]}); see the documentation"
        ) from None
    if values.size != 3 * n_points or (values.ndim == 2 and values.shape[1] != 3) or values.ndim > 2:
        raise InputError(
            f"{path}: an array of shape {values.shape}; the surface has {n_points} points of 3 coordinates"
        )
    points = values.reshape(-1, 3)
    is_bad = ~np.isfinite(points).all(axis=1)
    if is_bad.any():
        raise InputError(f"{path}: point {np.argmax(is_bad) + 1} is not finite; repair the file")
    return points


def _read_text(path: Path) -> np.ndarray:
    """Rows of numbers; the first line may be a heading."""
    lines = path.read_text(encoding="utf-8-sig").replace(",", " ").splitlines()
    rows = [line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if rows and not _is_numeric(rows[0]):
        rows = rows[1:]
    if any(len(row) != 3 for row in rows):
        number = next(n for n, row in enumerate(rows, start=1) if len(row) != 3)
        raise ValueError(f"point {number} has {len(rows[number - 1])} coordinates")
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _is_numeric(words: Sequence[str]) -> bool:
    try:
        [float(word) for word in words]
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class Request:
    """One deformation as requested."""

    text: str  # the text, for messages
    # name of the deformation, and its amount
    name: str
    value: str
    at: str | None  # place: the text after an ``@``
    options: dict[str, str]  # further values by name

    def fail(self, reason: str) -> InputError:
        """Error that quotes this text."""
        return InputError(f"deformation '{self.text}': {reason}")

    def only(self, *keys: str) -> None:
        """Refuse options other than these; ``"@"`` stands for a place."""
        unknown = [key for key in (*self.options, *(["@"] if self.at is not None else [])) if key not in keys]
        if unknown:
            allowed = " and ".join(keys) if keys else "no option"
            raise self.fail(f"'{unknown[0]}' is not known here; {self.name} takes {allowed}")

    def number(
        self, key: str | None = None, default: float = math.nan, low: float = -math.inf, high: float = math.inf
    ) -> float:
        """Read a number, the value itself or an option (``"@"``: the place), between exclusive bounds."""
        text = self.value if key is None else self.at if key == "@" else self.options.get(key)
        if text is None:
            return default
        return self._between(self._match(text, f"({_NUMBER})", "a number"), low, high)

    def angle(self, limit: float = 360.0) -> float:
        """Read the value as an angle below a limit (deg); returned in radians. The default unit is degrees."""
        text = self.value.removesuffix("deg")
        if text.endswith("rad"):
            degrees = math.degrees(self._match(text, f"({_NUMBER})rad", "an angle such as 30deg"))
        else:
            degrees = self._match(text, f"({_NUMBER})", "an angle such as 30deg")
        return math.radians(self._between(degrees, -limit, limit))

    def axis(self, word: str, or_else: str = "") -> np.ndarray:
        """Read the place as an axis, ``word(0,0,0 -> 0,0,1)``: two points, shape (2, 3)."""
        match = re.fullmatch(rf"{word}\({_POINT}->{_POINT}\)", self.at or "")
        if match is None:
            asked = "no axis is named" if self.at is None else f"'{self.at}' is no axis"
            raise self.fail(f"{asked}; write @{word}(x,y,z -> x,y,z){or_else}")
        numbers = np.array(match.groups(), dtype=float).reshape(2, 3)
        try:
            return Hinge(*numbers).points
        except InputError as error:
            raise self.fail(str(error).replace("hinge:", f"{word}:")) from None

    def between(self, key: str, default: tuple[float, float]) -> tuple[float, float]:
        """Read an option as two ascending fractions from 0 to 1, ``0.6:0.9``."""
        text = self.options.get(key)
        if text is None:
            return default
        match = re.fullmatch(f"({_NUMBER}):({_NUMBER})", text)
        low, high = (float(match[1]), float(match[2])) if match else (1.0, 0.0)
        if not 0.0 <= low < high <= 1.0:
            raise self.fail(f"{key} '{text}' is not two rising parts from 0 to 1; write for example {key}=0.6:0.9")
        return low, high

    def vector(self) -> tuple[float, float, float]:
        """Read the value as three numbers."""
        match = re.fullmatch(f"({_NUMBER})/({_NUMBER})/({_NUMBER})", self.value)
        if match is None:
            raise self.fail("give three lengths separated by slashes, such as translate=0.1/0/0")
        return float(match[1]), float(match[2]), float(match[3])

    def _match(self, text: str, pattern: str, what: str) -> float:
        match = re.fullmatch(pattern, text)
        if match is None:
            raise self.fail(f"'{text}' is not {what}")
        return float(match[1])

    def _between(self, number: float, low: float, high: float) -> float:
        if not low < number < high:
            bounds = f"above {low:g}" if math.isinf(high) else f"between {low:g} and {high:g}"
            raise self.fail(f"{number:g} is out of bounds; give a number {bounds}")
        return number


def parse_requests(text: str) -> list[Request]:
    """Split deformations joined by ``+``.

    Examples
    --------
    >>> [(request.name, request.value, request.at) for request in parse_requests("stretch=2+bend=120deg@0.7")]
    [('stretch', '2', None), ('bend', '120deg', '0.7')]
    """
    # `InputError` if the text is not of the form ``name=value``
    return [_parse(part.strip()) for part in re.split(r"\+(?=\s*[a-z])", text)]


def _parse(text: str) -> Request:
    first, *rest = re.split(r",(?![^()]*\))", text)
    pairs = []
    for word in (first, *rest):
        pair = re.fullmatch(r"\s*([a-z]+)\s*=\s*([^=]+?)\s*", word)
        if pair is None:
            raise InputError(
                f"deformation '{text}': '{word.strip()}' is not of the form name=value, such as twist=30deg; the "
                f"lengths of a vector are separated by slashes, as in translate=0.1/0/0"
            )
        pairs.append((pair[1], pair[2]))
    (name, value), *options = pairs
    value, *place = value.split("@", 1)
    return Request(text, name, value.strip(), place[0].strip() if place else None, dict(options))


def _requests(text: str) -> Sequence[Request | Path]:
    is_file = Path(text).suffix.lower() in SUFFIXES and not text.startswith("ffd=")
    return [Path(text)] if is_file else parse_requests(text)


def _make(request: Request | Path, surface: _Surface) -> PointMap:
    if isinstance(request, Path):
        return PrescribedPoints(read_points(request, len(surface.points)))
    if request.name not in DEFORMATIONS:
        raise request.fail(f"no deformation is called '{request.name}'; the names are {', '.join(DEFORMATIONS)}")
    return DEFORMATIONS[request.name](request, surface)


def _by_angle(make: Callable[..., PointMap], limit: float = 360.0) -> Callable[[Request, _Surface], PointMap]:
    """Deformation with an angle as its only value."""

    def build(request: Request, surface: _Surface) -> PointMap:
        request.only()
        return make(surface.frame, request.angle(limit))

    return build


def _by_factor(make: Callable[..., PointMap]) -> Callable[[Request, _Surface], PointMap]:
    """Deformation with a positive factor as its only value."""

    def build(request: Request, surface: _Surface) -> PointMap:
        request.only()
        return make(surface.frame, request.number(low=0.0))

    return build


def _bend(request: Request, surface: _Surface) -> Bend:
    request.only("@", "length")
    at = request.number("@", 0.7, low=-1e-12, high=1.0)
    length = request.number("length", min(0.15, 1.0 - at), low=0.0, high=1.0 + 1e-12)
    bend = Bend(surface.frame, request.angle(), at, length)
    _, normal, span = surface.frame.to_local(surface.points).T
    is_outboard = span >= (at - _INBOARD) * surface.frame.span
    highest = float(np.max(np.sign(bend.amount) * bend.height(normal[is_outboard]), initial=0.0))
    if highest * abs(bend.amount) >= length * surface.frame.span:
        least = highest * abs(bend.amount) / surface.frame.span
        raise request.fail(
            f"the arc is too tight for a surface {highest:.3g} m above its middle; give a length above {least:.2g}"
        )
    return bend


def _pitch(request: Request, surface: _Surface) -> Pitch:
    request.only("@")
    return Pitch(surface.frame, request.angle(), request.number("@", 0.25))


def _rotate(request: Request, surface: _Surface) -> Rotate:
    is_on_chord = (request.at or "").startswith("chord")
    request.only("@", "patches", "blend", "ends", *(["span"] if is_on_chord else []))
    angle = request.angle(math.inf)
    try:
        hinge = (
            _line(request, surface) if is_on_chord else request.axis("hinge", ", or @chord 0.7 for a part of the chord")
        )
        part = _rotated_part(request, surface, hinge)
    except InputError as error:
        raise error if str(error).startswith("deformation") else request.fail(str(error)) from None
    rotate = Rotate(hinge, angle, part)
    if part.behind is not None:
        _require_room(request, rotate, part.behind, surface)
    return rotate


def _rotated_part(request: Request, surface: _Surface, hinge: np.ndarray) -> RotatedPart:
    """What rotates about a hinge: named patches, what is behind the hinge line, or both."""
    blend = request.number("blend", 0.0, low=0.0)
    if "patches" not in request.options and not blend:
        raise request.fail(
            "say what turns: blend=LENGTH for what is behind the hinge line, or patches=NAMES, with * for all of them"
        )
    if "ends" in request.options and not blend:
        raise request.fail("ends is of what is behind the hinge line; give blend as well, or leave it out")
    ends = request.number("ends", blend)
    if not 0.0 <= ends < math.inf:
        raise request.fail(f"ends {ends:g} is no length; give one, or 0 for none")
    patches = [name.strip() for name in request.options.get("patches", "").split("/") if name.strip()]
    whole = surface.part(patches) if patches else None
    return RotatedPart(whole, BehindHinge(hinge, surface.frame.axes[0], blend, ends) if blend else None)


def _radius(request: Request, surface: _Surface) -> ScaleRadius:
    request.only("@", "along")
    ends = request.between("along", (0.0, 1.0)) if "along" in request.options else None
    return ScaleRadius(request.axis("axis"), request.number(low=0.0), ends)


def _axial(request: Request, surface: _Surface) -> StretchAlong:
    request.only("@")
    return StretchAlong(request.axis("axis"), request.number(low=0.0))


def _line(request: Request, surface: _Surface) -> np.ndarray:
    """The hinge at a fraction of the chord."""
    match = re.fullmatch(rf"chord\s+({_NUMBER})", request.at or "")
    if match is None or not 0.0 <= float(match[1]) <= 1.0:
        raise request.fail(f"'{request.at}' is no part of the chord from 0 to 1; write for example @chord 0.7")
    return surface.line(float(match[1]), request.between("span", (0.0, 1.0)))


def _require_room(request: Request, rotate: Rotate, behind: BehindHinge, surface: _Surface) -> None:
    """Refuse a blend in which the surface folds: areas change there by the factor ``1 - angle slope height``."""
    edges = edges_of_quads(surface_quads(surface.mesh))
    on_line = cut_edges(edges, behind.ahead(surface.points)).at(surface.points)
    points = np.concatenate([surface.points, on_line])
    is_blended = (behind.weights(points) > 0.0) & (behind.ahead(points) > -ON_LINE * surface.frame.chord)
    heights = rotate.amount * behind.height(points[is_blended])
    if _STEEPEST * heights.max(initial=0.0) >= behind.blend:
        highest, least = heights.max() / abs(rotate.amount), _STEEPEST * heights.max()
        raise request.fail(
            f"a surface {highest:.3g} m off the hinge folds in this blend; give a blend above {least:.2g}"
        )


def _lattice(request: Request, surface: _Surface) -> LatticeDeformation:
    request.only("to")
    if "to" not in request.options:
        raise request.fail("say where its points go, such as ffd=box.xyz,to=moved.xyz")
    return moved_lattice(request.value, request.options["to"])


def _cad(request: Request, surface: _Surface) -> CadDeformation:
    request.only("to", "scale")
    if "to" not in request.options:
        raise request.fail("say which file has the faces moved, such as cad=wing.step,to=twisted.step")
    scale = request.number("scale", low=0.0) if "scale" in request.options else None
    before, after = (body_of_file(surface.model, name, scale) for name in (request.value, request.options["to"]))
    walls = SurfaceGrid.of(surface.model, designed_patches(surface.model, surface.mesh))
    nodes = apply_maps(surface.before, walls.points)
    off = require_on_faces(before, before.tie(nodes), walls, nodes)
    return CadDeformation(before, before.matched(after), off=off)


def _translate(request: Request, surface: _Surface) -> Translate:
    request.only()
    return Translate(np.array(request.vector()))


def _bumps(request: Request, surface: _Surface) -> PointMap:
    request.only("seed", "wavelength")
    cells = request.value.removesuffix("cells")
    unit = surface.model.wall_spacing() if cells != request.value else 1.0
    height = Request(request.text, request.name, cells.strip(), None, {}).number(low=0.0)
    seed = request.number("seed", 0.0, low=-0.5)
    wavelength = request.number("wavelength", 0.5 * surface.frame.chord, low=0.0)
    return random_bumps(surface.points, height * unit, wavelength, int(seed), surface.planes)


DEFORMATIONS = {
    "twist": _by_angle(RotateSections, math.inf),
    "bend": _bend,
    "stretch": _by_factor(Stretch),
    "chord": _by_factor(ScaleChord),
    "thickness": _by_factor(ScaleThickness),
    "sweep": _by_angle(ShearDownstream, 85.0),
    "dihedral": _by_angle(ShearUpwards, 85.0),
    "pitch": _pitch,
    "rotate": _rotate,
    "radius": _radius,
    "axial": _axial,
    "translate": _translate,
    "bumps": _bumps,
    "ffd": _lattice,
    "cad": _cad,
}
"""Deformations by name, each made from a request and a surface."""
