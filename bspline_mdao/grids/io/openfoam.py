"""Grids and cases for OpenFOAM, in ASCII.

A grid is a folder ``polyMesh`` with points, faces, owner, neighbour and boundary; a case has it in ``constant``, fields
in ``0``, and dictionaries of settings in ``constant`` and ``system``.

Each shared node is written once. Faces with repeated corners become triangles, collapsed faces are left out, and the
rest is in OpenFOAM's order: inner faces by owner and neighbour, the owner being the lower cell, then patch after
patch.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Literal, get_args

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from ..cells.cell_faces import BoundaryFaces, CellFaces
from ..topology.detection import find_topology
from ..topology.grid import Grid
from ..topology.topology import Topology
from .disk import replaced_folder
from .formats import POLYMESH

__all__ = ["CaseField", "Planes", "PolyMesh", "case_texts", "foam_name", "put_texts", "write_case", "write_polymesh"]

Planes = Literal["symmetry", "symmetryPlane", "empty"]
"""OpenFOAM's types for patches of kind ``symmetry``."""

_HEAD = "FoamFile\n{{\n    version 2.0;\n    format ascii;\n    class {};\n{}    object {};\n}}\n\n"
_CHUNK = 100_000  # lines that are formatted at once
_NO_WORD = re.compile(r"[^\x21-\x7e]|[\"'/;{}()$#]")  # not allowed in names of OpenFOAM's dictionaries


def write_polymesh(folder: str | os.PathLike, grid: Grid, topology: Topology | None = None) -> None:
    """Write a grid for OpenFOAM.

    Patches of kind ``wall`` and ``symmetry`` get the type of that name, all others the type ``patch``; undeclared
    boundary is the patch ``unassigned``. Characters that OpenFOAM does not accept in a name become ``_``.

    Parameters
    ----------
    folder : path-like
        The folder to create, or whose mesh to replace: usually ``constant/polyMesh`` of a case.
    grid : Grid
        The grid.
    topology : Topology, optional
        The topology, found from the nodes by default. Pass the baseline's for a moved grid.

    Raises
    ------
    InputError
        If a block has no cells, cells have negative volumes, two patches have the same name in OpenFOAM, or a file
        cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from bspline_mdao.files import write_polymesh
    >>> from bspline_mdao.generators import brick_grid
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_polymesh(f"{folder}/polyMesh", brick_grid((5, 5, 5, 5)))
    ...     sorted(path.name for path in Path(folder, "polyMesh").iterdir())
    ['boundary', 'faces', 'neighbour', 'owner', 'points']
    """
    PolyMesh.of(topology or find_topology(grid), grid.to_vector().reshape(-1, 3)).write(folder)


@dataclass(frozen=True)
class CaseField(OneLine):
    """A field of an OpenFOAM case.

    Parameters
    ----------
    dimensions : str
        Exponents of its unit as OpenFOAM writes them, such as ``"[1 -1 -2 0 0 0 0]"`` for a pressure.
    value : float or sequence of three floats
        Initial value in all cells: a scalar or a vector.
    conditions : mapping of str to str
        Entries of the patches of each kind, such as ``{"wall": "type zeroGradient;"}``; ``"other"`` applies to all
        kinds that are not named, and to the patch ``unassigned``.

    Examples
    --------
    >>> from bspline_mdao.files import CaseField
    >>> CaseField("[0 2 -2 0 0 0 0]", 0.0, {"wall": "type zeroGradient;"})
    CaseField(dimensions='[0 2 -2 0 0 0 0]', value=0, conditions=1 by name)
    """

    dimensions: str
    value: float | Sequence[float]
    conditions: Mapping[str, str]


def write_case(
    folder: str | os.PathLike,
    grid: Grid,
    fields: Mapping[str, CaseField],
    settings: Mapping[str, str],
    topology: Topology | None = None,
    planes: Planes = "symmetry",
) -> None:
    """Write a case for OpenFOAM: the grid, initial fields, and settings.

    Parameters
    ----------
    folder : path-like
        The case to create, or whose files to replace.
    grid : Grid
        The grid, which becomes ``constant/polyMesh``, see `write_polymesh`.
    fields : mapping of str to CaseField
        Fields by name, such as ``"p"`` and ``"U"``, which become the files of ``0``.
    settings : mapping of str to str
        Text of dictionaries by place, such as ``"system/controlDict"``; their headers are added.
    topology : Topology, optional
        The topology, found from the nodes by default. Pass the baseline's for a moved grid.
    planes : {"symmetry", "symmetryPlane", "empty"}
        OpenFOAM's type of patches of kind ``symmetry``. A grid one cell deep between two such planes is solved in two
        dimensions as ``empty``; the fields need ``type empty;`` there.

    Raises
    ------
    InputError
        As in `write_polymesh`; or if a field has no condition for a patch, is neither scalar nor vector, a dictionary
        has no place below the case, or planes are ``empty`` but cells do not lie one deep between them. Nothing is
        written then.

    Examples
    --------
    >>> import tempfile
    >>> from bspline_mdao.files import CaseField, write_case
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> conditions = {"wall": "type zeroGradient;", "symmetry": "type symmetry;", "other": "type slip;"}
    >>> settings = {"system/controlDict": "application potentialFoam; endTime 1; deltaT 1;"}
    >>> fields = {"p": CaseField("[0 2 -2 0 0 0 0]", 0.0, conditions)}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_case(folder, flat_plate_grid((5, 5, 5)), fields, settings)
    ...     sorted(os.listdir(folder))
    ['0', 'constant', 'system']
    """
    mesh = PolyMesh.of(topology or find_topology(grid), grid.to_vector().reshape(-1, 3))
    mesh.write_case(folder, fields, settings, planes)


@dataclass(frozen=True, eq=False)
class PolyMesh:
    """Faces in OpenFOAM's order between the cells of a multi-block grid."""

    points: np.ndarray  # (n_points, 3), each shared node once (m)
    corners: np.ndarray  # (n_faces, 4) of int, points of each face, in order; the area vector points out of the owner
    is_corner: np.ndarray  # (n_faces, 4) of bool, false for corners that repeat the next one
    # owner, neighbour: (n_faces,) and (n_inner,) of int, cells on both sides, numbered as in `CellFaces`
    owner: np.ndarray
    neighbour: np.ndarray
    boundary: tuple[BoundaryFaces, ...]  # the patches, with their names in OpenFOAM
    rows: np.ndarray  # (n_points,) of int, node of each point

    @classmethod
    def of(
        cls,
        topology: Topology,  # topology of its blocks
        nodes: np.ndarray,  # (n_nodes, 3), its nodes (m)
    ) -> PolyMesh:
        """Order the faces of a grid."""
        cells = CellFaces.of(topology, nodes)
        cells.require_volumes(nodes)
        is_corner = cells.corners != np.roll(cells.corners, -1, axis=1)
        inner, edge = _kept(cells, has_area=is_corner.sum(axis=1) > 2)
        is_turned = np.append(cells.left[inner] > cells.right[inner], np.zeros(len(edge), dtype=bool))[:, None]
        order = np.concatenate([inner, edge])
        corners, is_corner = (
            np.where(is_turned, part[order, ::-1], part[order]) for part in (cells.corners, is_corner)
        )
        sides = np.sort([cells.left[inner], cells.right[inner]], axis=0)
        used, numbers = np.unique(corners, return_inverse=True)
        return cls(
            points=nodes[used],
            corners=numbers.reshape(corners.shape),
            is_corner=is_corner,
            owner=np.concatenate([sides[0], cells.left[edge]]),
            neighbour=sides[1],
            boundary=_renumbered(cells.boundary, len(inner), edge),
            rows=used,
        )

    def at(self, nodes: np.ndarray) -> PolyMesh:
        """Take new nodes, shape (n_nodes, 3) (m)."""
        return replace(self, points=nodes[self.rows])

    def write(
        self,
        folder: str | os.PathLike,  # the folder, created if needed
        planes: Planes = "symmetry",  # type of patches of kind symmetry
    ) -> None:
        """Write the five files, all or none."""
        with replaced_folder(folder) as new:
            for name, (kind, n, lines) in self._files(planes).items():
                with open(new / name, "w", encoding="ascii") as file:
                    file.write(_HEAD.format(kind, self._note() if "label" in kind else "", name) + f"{n}\n(\n")
                    file.writelines(lines)
                    file.write(")\n")

    def write_case(
        self,
        folder: str | os.PathLike,
        fields: Mapping[str, CaseField],
        settings: Mapping[str, str],
        planes: Planes = "symmetry",
    ) -> None:
        """Write a case with this mesh.

        Parameters
        ----------
        folder : path-like
            The case.
        fields, settings : mapping
            See `write_case`, the function.
        planes : {"symmetry", "symmetryPlane", "empty"}
            See there.

        Raises
        ------
        InputError
            As there.
        """
        self.require_depth(planes)
        texts = case_texts(fields, settings, self.boundary)
        self.write(Path(folder) / "constant" / POLYMESH, planes)
        put_texts(folder, texts)

    def require_depth(self, planes: Planes) -> None:
        """Refuse unknown types, and ``empty`` for planes that do not have every cell between them."""
        if planes not in get_args(Planes):
            raise InputError(f"OpenFOAM: planes of type '{planes}'; give one of {', '.join(get_args(Planes))}")
        n_faces = sum(patch.stop - patch.start for patch in self.boundary if patch.kind == "symmetry")
        n_cells = int(self.owner.max()) + 1
        if planes == "empty" and n_faces != 2 * n_cells:
            raise InputError(
                f"OpenFOAM: patches of kind symmetry have {n_faces:,} faces, and 'empty' ones would have "
                f"{2 * n_cells:,}, two for each cell; give planes 'symmetry', or a grid one cell deep"
            )

    def _files(self, planes: Planes) -> dict[str, tuple[str, int, Iterable[str]]]:
        """Class, number of entries and text of every file."""
        forms = np.array(["3(%d %d %d)\n", "4(%d %d %d %d)\n"])[self.is_corner.sum(axis=1) - 3]
        return {
            "points": ("vectorField", len(self.points), _lines("(%.17g %.17g %.17g)\n", self.points)),
            "faces": ("faceList", len(self.corners), _ragged_lines(forms, self.corners, self.is_corner)),
            "owner": ("labelList", len(self.owner), _lines("%d\n", self.owner[:, None])),
            "neighbour": ("labelList", len(self.neighbour), _lines("%d\n", self.neighbour[:, None])),
            "boundary": ("polyBoundaryMesh", len(self.boundary), (_entry(patch, planes) for patch in self.boundary)),
        }

    def _note(self) -> str:
        """Sizes, which OpenFOAM's tools read in the header of owner and neighbour."""
        n_cells = int(self.owner.max()) + 1
        sizes = f"nPoints:{len(self.points)} nCells:{n_cells} nFaces:{len(self.owner)}"
        return f'    note "{sizes} nInternalFaces:{len(self.neighbour)}";\n'


CaseTexts = dict[tuple[str, str], tuple[str, str]]
"""Class and text of files by their folders in a case, and names."""


def case_texts(
    fields: Mapping[str, CaseField], settings: Mapping[str, str], boundary: Sequence[BoundaryFaces]
) -> CaseTexts:
    """Texts of fields and settings of a case with some patches."""
    texts = {("0", name): _field_text(name, field, boundary) for name, field in fields.items()}
    for place, text in settings.items():
        above, name = PurePosixPath(place).parent, PurePosixPath(place).name
        if str(above) == "." or ".." in above.parts or above.is_absolute():
            raise InputError(f"OpenFOAM: '{place}' is no place in a case; name it as 'system/controlDict'")
        texts[str(above), name] = "dictionary", text
    return texts


def put_texts(folder: str | os.PathLike, texts: CaseTexts) -> None:
    """Write texts into a case, all of a folder or none."""
    for parent in dict.fromkeys(parent for parent, _ in texts):
        with replaced_folder(Path(folder) / parent) as new:
            for (where, name), (kind, text) in texts.items():
                if where == parent:
                    head = f"FoamFile {{ version 2.0; format ascii; class {kind}; object {name}; }}\n"
                    (new / name).write_text(head + text, encoding="ascii")


def foam_name(name: str) -> str:
    """Name of a patch in OpenFOAM."""
    return _NO_WORD.sub("_", name)


def _kept(cells: CellFaces, has_area: np.ndarray) -> tuple[np.ndarray, ...]:
    """Inner faces in order of the lower and then the higher cell, and boundary faces, without collapsed ones."""
    left, right = cells.left[: cells.n_inner], cells.right
    order = np.lexsort((np.maximum(left, right), np.minimum(left, right)))
    is_between = has_area[: cells.n_inner] & (left != right)  # a cell closed on itself has no face there
    return order[is_between[order]], cells.n_inner + np.flatnonzero(has_area[cells.n_inner :])


def _renumbered(boundary: Sequence[BoundaryFaces], n_inner: int, edge: np.ndarray) -> tuple[BoundaryFaces, ...]:
    """Patches with names for OpenFOAM and the ranges of their remaining faces."""
    names = [foam_name(patch.name) for patch in boundary]
    for patch, name in zip(boundary, names):
        if names.count(name) > 1:
            raise InputError(f"patch {patch.name}: another patch is '{name}' to OpenFOAM, too; rename one of them")
    ends = n_inner + np.searchsorted(edge, [(patch.start, patch.stop) for patch in boundary]).reshape(-1, 2)
    return tuple(
        replace(patch, name=name, start=start, stop=stop)
        for patch, name, (start, stop) in zip(boundary, names, ends.tolist())
    )


def _lines(form: str, values: np.ndarray) -> Iterable[str]:
    """Rows of values in words."""
    for start in range(0, len(values), _CHUNK):
        part = values[start : start + _CHUNK]
        yield form * len(part) % tuple(part.ravel().tolist())


def _ragged_lines(forms: np.ndarray, values: np.ndarray, is_there: np.ndarray) -> Iterable[str]:
    """Rows of those values that are there in words, each row in its own form."""
    for start in range(0, len(values), _CHUNK):
        part = slice(start, start + _CHUNK)
        yield "".join(forms[part].tolist()) % tuple(values[part][is_there[part]].tolist())


def _entry(patch: BoundaryFaces, planes: Planes) -> str:
    """Entry of a patch in the file ``boundary``."""
    sizes = f"nFaces {patch.stop - patch.start};\n        startFace {patch.start};"
    kind = {"wall": "wall", "symmetry": planes}.get(patch.kind or "", "patch")
    return f"    {patch.name}\n    {{\n        type {kind};\n        {sizes}\n    }}\n"


def _field_text(name: str, field: CaseField, boundary: Sequence[BoundaryFaces]) -> tuple[str, str]:
    """Class of a field and its text below the head."""
    value = np.asarray(field.value, dtype=float)
    if value.shape not in ((), (3,)):
        raise InputError(f"OpenFOAM: field '{name}' has a value of shape {value.shape}; give a number or three")
    entries = []
    for patch in boundary:
        condition = field.conditions.get(patch.kind or "other", field.conditions.get("other"))
        if condition is None:
            raise InputError(
                f"OpenFOAM: field '{name}' has no condition for patch '{patch.name}' of kind {patch.kind or 'other'}; "
                f"add it, or one for 'other'"
            )
        entries.append(f"{patch.name} {{ {condition} }}\n")
    words = f"({' '.join(map(str, value.tolist()))})" if value.ndim else str(value.tolist())
    start = f"dimensions {field.dimensions};\ninternalField uniform {words};\n"
    return (
        "volVectorField" if value.ndim else "volScalarField",
        f"{start}boundaryField\n{{\n{''.join(entries)}}}\n",
    )
