"""STEP and IGES files by OpenCascade, with patch names on the faces and the unit of the file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from .cad_body import NUMBERED, CadBody
from .opencascade import MILLIMETRES, compound, free_edges, require_opencascade, sub_shapes
from .read_faces import spline_faces, trimmed_face

__all__ = ["SUFFIXES", "UNITS", "CadShape", "check_cad_name", "read_cad", "read_shape", "write_shape"]

SUFFIXES = {".step": "STEP", ".stp": "STEP", ".iges": "IGES", ".igs": "IGES"}
"""Format by suffix."""

UNITS = {"m": "M", "mm": "MM", "in": "INCH", "ft": "FT"}
"""Units of length of files, with OpenCascade's names for them."""

UNIT_WORDS = {"metre": "m", "millimetre": "mm", "inch": "in", "foot": "ft"} | {unit: unit for unit in UNITS}
"""Units by their words in files of both formats."""

FACES_WITH_EDGES = 1
"""IGES: faces with shared edges (entities 186 and 514), not each with its own curves (144)."""

TRIMMED_SURFACE = 144
"""IGES: entity of a face with its own curves."""


@dataclass(frozen=True, eq=False)
class CadShape(OneLine):
    """The contents of a CAD file. Made by `read_cad`.

    Parameters
    ----------
    n_faces, n_shells, n_solids : int
        Their numbers.
    names : tuple of str
        Names of the named faces.
    is_valid : bool
        Whether OpenCascade finds nothing wrong: curves on their surfaces, closed wires, shells whose faces agree.
    free_edges : tuple of ndarray, each of shape (9, 3)
        Points (m) of every edge that belongs to only one face.
    shape : TopoDS_Shape
        OpenCascade's own object, in millimetres.
    source : str
        The file.
    unit : str
        Unit of length of the file; lengths here are always in metres.
    face_names : tuple of str
        Name of every face in the order of the file; ``"face 3"`` for the third if it has none.

    Examples
    --------
    >>> from bspline_mdao.files import read_cad
    >>> wing = read_cad("wing.step")  # doctest: +SKIP
    >>> wing.names, wing.is_valid, len(wing.free_edges)  # doctest: +SKIP
    (('wing_lower', 'wing_upper'), True, 2)
    """

    n_faces: int
    n_shells: int
    n_solids: int
    names: tuple[str, ...]
    is_valid: bool
    free_edges: tuple[np.ndarray, ...]
    shape: Any
    source: str = ""
    unit: str = ""
    face_names: tuple[str, ...] = ()

    @cached_property
    def body(self) -> CadBody:
        """The faces as B-spline surfaces of this package, to tie nodes to; OpenCascade converts other surfaces."""
        converted, faces = spline_faces(self.shape)
        trimmed = tuple(trimmed_face(face, name) for face, name in zip(faces, self.face_names))
        return CadBody(self.source, trimmed, units=UNIT_WORDS.get(self.unit.lower(), "m"), origin=converted)

    @property
    def is_closed(self) -> bool:
        """Whether no edge is free."""
        return not self.free_edges

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distances (m), shape (n,), of points (m), shape (n, 3), from the faces, by projection.

        OpenCascade projects point by point, in about a millisecond for each nearby face.
        """
        from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeVertex
        from OCP.BRepExtrema import BRepExtrema_DistShapeShape
        from OCP.gp import gp_Pnt

        faces, found = compound(sub_shapes(self.shape, "face")), []
        for point in (np.asarray(points, dtype=float) * MILLIMETRES).tolist():
            vertex = BRepBuilderAPI_MakeVertex(gp_Pnt(*point)).Vertex()
            found.append(BRepExtrema_DistShapeShape(vertex, faces).Value() / MILLIMETRES)
        return np.array(found)


def check_cad_name(path: str | os.PathLike, units: str = "m") -> str:
    """Return the format implied by a file name, ``"STEP"`` or ``"IGES"``."""
    form = SUFFIXES.get(Path(path).suffix.lower())
    if form is None:
        raise InputError(f"{path}: no CAD file by its name; end it in {', '.join(SUFFIXES)}")
    if units not in UNITS:
        raise InputError(f"{path}: no unit is called '{units}'; choose one of {', '.join(UNITS)}")
    return form


def write_shape(
    path: str | os.PathLike,  # file to make
    form: str,  # its format
    shape: Any,  # the shape (mm)
    faces: Sequence[Any],  # faces of it
    names: Sequence[str],  # their names
    title: str,  # name of the shape
    units: str,  # unit of the file, one of `UNITS`
) -> None:
    """Write a shape, with a name for each of its faces."""
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document = _document()
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    label = tool.AddShape(shape, False)
    TDataStd_Name.Set_s(label, TCollection_ExtendedString(title, True))
    for face, name in zip(faces, names):
        of_face = tool.AddSubShape(label, face)
        TDataStd_Name.Set_s(of_face, TCollection_ExtendedString(name, True))
    writer = _step_writer(UNITS[units]) if form == "STEP" else _iges_writer(UNITS[units])
    with quiet():
        if not (writer.Transfer(document) and writer.Write(str(path)) in _done()):
            raise InputError(f"{path}: OpenCascade could not write {form}; check that the disk has room")


def _done() -> tuple:
    """Status of writers and readers on success."""
    from OCP.IFSelect import IFSelect_ReturnStatus

    return (IFSelect_ReturnStatus.IFSelect_RetDone, True)


def _document() -> Any:
    """Return an empty document, in millimetres."""
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document = TDocStd_Document(TCollection_ExtendedString("MDTV-XCAF"))
    XCAFDoc_DocumentTool.SetLengthUnit_s(document, 1.0 / MILLIMETRES)
    return document


def _step_writer(unit: str) -> Any:
    from OCP.Interface import Interface_Static
    from OCP.STEPCAFControl import STEPCAFControl_Writer

    writer = STEPCAFControl_Writer()  # it declares the parameters set next
    Interface_Static.SetCVal_s("write.step.unit", unit)
    Interface_Static.SetIVal_s("write.stepcaf.subshapes.name", 1)
    writer = STEPCAFControl_Writer()
    writer.SetNameMode(True)
    return writer


def _iges_writer(unit: str) -> Any:
    from OCP.IGESCAFControl import IGESCAFControl_Writer
    from OCP.IGESControl import IGESControl_Controller
    from OCP.Interface import Interface_Static

    IGESControl_Controller.Init_s()
    Interface_Static.SetCVal_s("write.iges.unit", unit)
    Interface_Static.SetIVal_s("write.iges.brep.mode", FACES_WITH_EDGES)
    writer = IGESCAFControl_Writer()
    writer.SetNameMode(True)
    return writer


class quiet:
    """Silence OpenCascade's printing about what it writes and reads."""

    def __enter__(self) -> None:
        from OCP.Message import Message

        messenger = Message.DefaultMessenger_s()
        self._printers = list(messenger.Printers())
        for printer in self._printers:
            messenger.RemovePrinter(printer)

    def __exit__(self, *error: object) -> None:
        from OCP.Message import Message

        for printer in self._printers:
            Message.DefaultMessenger_s().AddPrinter(printer)


def read_cad(path: str | os.PathLike) -> CadShape:
    """Read a CAD file by OpenCascade, and inspect its contents.

    Parameters
    ----------
    path : path-like
        A STEP or IGES file.

    Returns
    -------
    CadShape

    Raises
    ------
    InputError
        If the file cannot be read, or OpenCascade is not installed.

    Examples
    --------
    >>> from bspline_mdao.files import read_cad
    >>> read_cad("wing.step").distances([[0.5, 0.1, 0.2]])  # of points (m), by projection  # doctest: +SKIP
    array([0.05130114])
    """
    form = check_cad_name(path)
    require_opencascade()
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; check the name")
    return read_shape(path, form)


def read_shape(path: str | os.PathLike, form: str) -> CadShape:
    """Read a file of a format, ``"STEP"`` or ``"IGES"``, whatever its name; see `read_cad`."""
    reader, document = _reader(form), _document()
    with quiet():
        if reader.ReadFile(str(path)) not in _done() or not reader.Transfer(document):
            raise InputError(f"{path}: OpenCascade cannot read it as {form}; check that it is complete")
    shape, labels = _contents(document)
    faces = sub_shapes(shape, "face")
    names = _names_by_labels(faces, labels) if form == "STEP" else _names_of_iges(reader.IGESModel(), len(faces))
    if not faces:
        raise InputError(f"{path}: no face is in it; name a file of surfaces")
    return CadShape(
        n_faces=len(faces),
        n_shells=len(sub_shapes(shape, "shell")),
        n_solids=len(sub_shapes(shape, "solid")),
        names=tuple(sorted(name for name in names if name)),
        is_valid=_is_valid(shape),
        free_edges=tuple(free_edges(shape)),
        shape=shape,
        source=str(path),
        unit=_unit(reader, form),
        face_names=tuple(name or f"{NUMBERED}{number}" for number, name in enumerate(names, start=1)),
    )


def _reader(form: str) -> Any:
    if form == "STEP":
        from OCP.Interface import Interface_Static
        from OCP.STEPCAFControl import STEPCAFControl_Reader

        reader = STEPCAFControl_Reader()
        Interface_Static.SetIVal_s("read.stepcaf.subshapes.name", 1)
        reader = STEPCAFControl_Reader()
        reader.SetNameMode(True)
        return reader
    from OCP.IGESCAFControl import IGESCAFControl_Reader

    reader = IGESCAFControl_Reader()
    reader.SetNameMode(True)
    return reader


def _is_valid(shape: Any) -> bool:
    from OCP.BRepCheck import BRepCheck_Analyzer

    return bool(BRepCheck_Analyzer(shape).IsValid())


def _unit(reader: Any, form: str) -> str:
    """Name of the unit of length as written in the file: ``"millimetre"``, ``"MM"``."""
    if form == "IGES":
        return str(reader.IGESModel().GlobalSection().UnitName().ToCString())
    from OCP.collections import Sequence_TCollection_AsciiString as Names

    lengths, angles, solid_angles = Names(), Names(), Names()
    reader.ChangeReader().FileUnits(lengths, angles, solid_angles)
    return lengths.Value(1).ToCString() if lengths.Length() else ""


def _contents(document: Any) -> tuple[Any, list[tuple[Any, str]]]:
    """Shape of everything in a document, and its parts with their names."""
    from OCP.collections import Sequence_TDF_Label
    from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

    tool, roots, every = XCAFDoc_DocumentTool.ShapeTool_s(document.Main()), Sequence_TDF_Label(), Sequence_TDF_Label()
    tool.GetFreeShapes(roots)
    shapes = [XCAFDoc_ShapeTool.GetShape_s(roots.Value(number)) for number in range(1, roots.Length() + 1)]
    tool.GetShapes(every)  # parts of assemblies, too
    named = []
    for number in range(1, every.Length() + 1):
        parts = Sequence_TDF_Label()
        XCAFDoc_ShapeTool.GetSubShapes_s(every.Value(number), parts)
        labels = [parts.Value(part) for part in range(1, parts.Length() + 1)]
        named += [(XCAFDoc_ShapeTool.GetShape_s(label), name) for label in labels if (name := _name(label))]
    return (shapes[0] if len(shapes) == 1 else compound(shapes)), named


def _names_by_labels(faces: Sequence[Any], labels: Sequence[tuple[Any, str]]) -> list[str]:
    """Names of faces, wherever an assembly has placed them; empty for unnamed ones."""
    return [next((name for part, name in labels if part.IsPartner(face)), "") for face in faces]


def _names_of_iges(model: Any, n_faces: int) -> list[str]:
    """Names of the faces of shells, or of trimmed surfaces: OpenCascade keeps their order but not the names."""
    from OCP.IGESSolid import IGESSolid_Shell

    entities = [model.Entity(number) for number in range(1, model.NbEntities() + 1)]
    shells = [entity for entity in entities if isinstance(entity, IGESSolid_Shell)]
    parts = [shell.Face(number) for shell in shells for number in range(1, shell.NbFaces() + 1)]
    parts = parts or [entity for entity in entities if entity.TypeNumber() == TRIMMED_SURFACE]
    if len(parts) != n_faces:
        return [""] * n_faces
    return [part.NameValue().String().ToCString() if part.HasName() else "" for part in parts]


def _name(label: Any) -> str:
    from OCP.TDataStd import TDataStd_Name

    name = TDataStd_Name()
    return name.Get().ToExtString() if label.FindAttribute(TDataStd_Name.GetID_s(), name) else ""
