"""One HDF5 file for a fitted model, written from its fields and read back into them.

Layout, version 5. Version 4 had no tied sides; version 3 had no lengths of the residual; version 2 had a smoothing
instead of a method in its settings; version 1 also had no parametrization, and no memory of a factor in its report::

    /                       attributes: format, version, checksum, seconds of the fit
    /document               JSON (UTF-8): topology, grid header, report, settings, orders
    /control_points         (n_control_points, 3)
        /residual               (n_nodes, 3), if it is kept
        /residual_lengths       (n_corners,), if it turns: for processes that read a part of it
    /control_ids/<s>        ids of the control points of segment s
    /parameters/<s>         parameters of its nodes
    /knots/<s>/<d>          (N + p,) constant or (2, 2, N + p) bilinear knots of direction d
        /iblank/<b>             blanking of block b, if it has one
        /shares                 (n_control_points, 6) weights of the candidates, if not all are least squares
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np

from ...errors import InputError
from ...grids.io.cgns import CgnsDialect
from ...grids.io.disk import deferred_interrupts, replaced_hdf5_file
from ...grids.io.formats import MESH_MODEL_FORMAT, MODEL, MODEL_FORMAT
from ...grids.io.plane_grids import PlaneDialect
from ...grids.io.plot3d_dialect import Plot3dDialect
from ...grids.topology.grid import Patch
from ...grids.topology.index_space import Interface, Orientation, Window
from ...grids.topology.periodic_pair import Motion
from ...grids.topology.topology import BoundaryFace, Collapse, Link, NearMiss, PeriodicLinks, Topology
from ..splines.knots import knots_from_array, knots_to_array
from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume
from .records import (
    CANDIDATES,
    BlockError,
    Fallback,
    FitReport,
    FitSettings,
    GridHeader,
    InvalidElement,
    LocalError,
    Raised,
    WorstNode,
)

VERSION = 5

CHECKED_BYTES = 2**24
"""About how many bytes of a dataset are read at a time for the checksum."""

_LARGEST_RATIO = 2000
"""More bytes in memory than this for each byte of the file are a sign of damage (gzip reaches about 1000)."""

_RECORDS = {
    record.__name__: record
    for record in (
        *(BlockError, Fallback, FitReport, InvalidElement, LocalError, Raised, WorstNode),
        *(FitSettings, GridHeader, Patch, Topology),
        *(
            BoundaryFace,
            Collapse,
            Interface,
            Link,
            Motion,
            NearMiss,
            Orientation,
            PeriodicLinks,
            Window,
            Plot3dDialect,
            CgnsDialect,
            PlaneDialect,
        ),
    )
}


Model = TypeVar("Model")


def write_model(
    fields_of_model: Mapping[str, Any],  # the fields of a `bspline_mdao.core.model.fitted_model.FittedModel` by name
    path: str | os.PathLike,  # the file
    compress: bool = True,  # compress the arrays
) -> None:
    """Write a model; an existing file is replaced only when the new one is complete."""
    arrays, document, options = arrays_of(**fields_of_model), document_of(**fields_of_model), dataset_options(compress)
    with replaced_hdf5_file(path) as file:
        attributes = attributes_of(**fields_of_model) | {"checksum": checksum_of(document, arrays)}
        with deferred_interrupts():
            file.attrs.update(attributes)
            file["document"] = np.frombuffer(document, np.uint8)
        for name, array in arrays.items():
            with deferred_interrupts():
                file.create_dataset(name, data=array, **options)


def read_model(
    path: str | os.PathLike,  # file that `write_model` made
    # makes the model from its fields, given by name; an `InputError` from it means that they are damaged
    make: Callable[..., Model],
) -> Model:  # what ``make`` returns
    """Read a model and check it."""
    with damaged_is_input_error(path), opened_model(path) as file:
        arrays = datasets_of(path, file)
        document = checked_document(file, arrays)
        stored = {name: item[()] for name, item in arrays.items()}
        _bring_up_to_date(path, document, stored)
        document = _decode_of(file, document)
        fields_of_model = _fields_of(document, stored)
        parameters = tuple(stored[f"parameters/{s}"] for s in range(len(document["orders"])))
        for s, array in enumerate(parameters):
            check_parameters(document["topology"], s, array.shape, array)
        iblanks = tuple(stored.get(f"iblank/{b}") for b in range(len(document["header"].names)))
        header = replace(document["header"], iblanks=iblanks)
        rest = {"parameters": parameters, "residual": stored.get("residual"), "header": header}
        rest["residual_lengths"] = _checked_lengths(path, stored, is_turned=False)  # computed again before version 4
        return make(**fields_of_model | rest)


def read_fields(
    path: str | os.PathLike,
) -> dict[str, object]:  # fields by name; also ``has_residual``, whether the file has one
    """Read and check all fields of a model but the large ones: parameters, residual and blanking."""
    # The whole file is read once, a piece at a time, for its checksum.
    with damaged_is_input_error(path), opened_model(path) as file:
        arrays = datasets_of(path, file)
        document = checked_document(file, arrays)
        stored = {name: item[()] for name, item in arrays.items() if not is_of_grid(name)}
        _bring_up_to_date(path, document, stored)
        document = _decode_of(file, document)
        found = _fields_of(document, stored)
        for s in range(len(document["orders"])):
            check_parameters(document["topology"], s, arrays[f"parameters/{s}"].shape)
        has_residual = "residual" in arrays
        found["residual_lengths"] = _checked_lengths(path, stored, has_residual and document["settings"].wall_layer)
        if has_residual and arrays["residual"].shape != (document["topology"].n_nodes, 3):
            raise ValueError("residual")
        return found | {"has_residual": has_residual}


def checksum_in(path: str | os.PathLike) -> str | None:
    """Checksum stated in the file of a model, of a grid or a mesh; None if it is no such file."""
    try:
        with deferred_interrupts(), h5py.File(path, "r") as file:
            is_model = file.attrs.get("format") in (MODEL_FORMAT, MESH_MODEL_FORMAT)
            return str(file.attrs["checksum"]) if is_model else None
    except (OSError, RuntimeError, KeyError):
        return None


def is_of_grid(name: str) -> bool:
    """Whether a dataset is of the size of the grid or one of its blocks."""
    return name.split("/")[0] in ("parameters", "residual", "iblank")


@contextmanager
def damaged_is_input_error(
    path: str | os.PathLike, message: str = "the fitted model is damaged; fit the grid again"
) -> Iterator[None]:
    """Turn any error that a damaged file leads to into an `InputError` of one line that names the file."""
    try:
        yield
    except InputError as error:
        raise error if str(error).startswith(str(path)) else InputError(f"{path}: {message}") from error
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, AttributeError, IndexError, MemoryError) as error:
        raise InputError(f"{path}: {message}") from error


@contextmanager
def opened_model(path: str | os.PathLike) -> Iterator[h5py.File]:
    """Open the file of a model whose format and version are right, for reading."""
    if not Path(path).is_file():
        raise InputError(f"{path}: there is no such file; give a fitted model")
    if not h5py.is_hdf5(path):
        made = f"bspline-mdao fit {Path(path).name} -o {Path(path).stem}.h5"
        raise InputError(f"{path}: is not a fitted model (no HDF5 file); make one with the command fit, as by '{made}'")
    with deferred_interrupts(), h5py.File(path, "r") as file:
        if "CGNSLibraryVersion" in file:
            raise InputError(f"{path}: is a CGNS grid, and {MODEL} is a fitted model; name it .cgns, or fit it first")
        if file.attrs.get("format") == MESH_MODEL_FORMAT:
            raise InputError(
                f"{path}: is the model of a lattice around a mesh, and a fitted grid is needed here; read it by "
                f"MeshModel.load in Python, and give its mesh {file.attrs.get('mesh_file', '')} to inspect and quality"
            )
        if file.attrs.get("format") != MODEL_FORMAT:
            raise InputError(f"{path}: is an HDF5 file, but not a fitted model; make one with the command fit")
        if file.attrs["version"] > VERSION:
            raise InputError(
                f"{path}: is of version {file.attrs['version']}, newer than {VERSION}, the newest known here; "
                f"update the program"
            )
        yield file


def datasets_of(path: str | os.PathLike, file: h5py.File) -> dict[str, h5py.Dataset]:
    """All datasets of a file by their names; ValueError if one claims more than the file can hold."""
    found: dict[str, h5py.Dataset] = {}
    limit = _LARGEST_RATIO * os.path.getsize(path)

    def take(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            if item.nbytes > limit:
                raise ValueError(name)
            found[name] = item

    file.visititems(take)
    return found


def checked_document(file: h5py.File, arrays: dict[str, h5py.Dataset]) -> dict:
    """Take the document out of the datasets of a file whose checksum is right, and read it."""
    content = arrays.pop("document")[()].tobytes()
    if file.attrs["checksum"] != checksum_of(content, arrays):
        raise ValueError("checksum")
    return json.loads(content)


def checksum_of(document: bytes, arrays: Mapping[str, np.ndarray | h5py.Dataset]) -> str:
    """Checksum of everything in a file, the same on all machines; datasets are read a piece at a time."""
    digest = hashlib.blake2b(document, digest_size=16)
    for name in sorted(arrays):
        array = arrays[name]
        little = array.dtype.newbyteorder("<")
        digest.update(f"{name} {array.shape} {little.str}".encode())
        n_lines = max(1, CHECKED_BYTES * array.shape[0] // max(array.nbytes, 1)) if array.ndim else 1
        for start in range(0, array.shape[0] if array.ndim else 1, n_lines):
            piece = array[start : start + n_lines] if array.ndim else array[()]
            digest.update(np.ascontiguousarray(piece, little).data)
    return digest.hexdigest()


def _bring_up_to_date(path: str | os.PathLike, document: dict, arrays: dict[str, np.ndarray]) -> None:
    """Translate the smoothing of versions 1 and 2: none is least squares, infinity the coarse grid."""
    settings = document["settings"]
    if "smoothing" not in settings:
        return
    smoothing = settings.pop("smoothing")
    if 0.0 < smoothing < math.inf:
        raise InputError(f"{path}: the fitted model is smoothed, which is no longer known; fit the grid again")
    settings["method"] = "quasi_interpolant" if smoothing else "least_squares"
    if smoothing:
        arrays["shares"] = np.eye(len(CANDIDATES))[np.full(len(arrays["control_points"]), len(CANDIDATES) - 1)]


def dataset_options(compress: bool) -> dict[str, object]:
    """Options of all datasets."""
    return {"compression": "gzip", "compression_opts": 1, "shuffle": True} if compress else {}


def arrays_of(
    mesh: BSplineMesh,
    parameters: Sequence[np.ndarray],
    control_points: np.ndarray,
    residual: np.ndarray | None,
    header: GridHeader,
    candidate_weights: np.ndarray | None,
    residual_lengths: np.ndarray | None,
    **_: Any,
) -> dict[str, np.ndarray]:
    """Arrays of a model's fields by their names in the file."""
    arrays = {"control_points": control_points, "residual": residual, "shares": candidate_weights}
    arrays["residual_lengths"] = residual_lengths
    for s, (volume, ids, x) in enumerate(zip(mesh.volumes, mesh.control_ids, parameters)):
        arrays[f"control_ids/{s}"], arrays[f"parameters/{s}"] = ids, x
        arrays.update({f"knots/{s}/{d}": knots_to_array(knots) for d, knots in enumerate(volume.knots)})
    arrays.update({f"iblank/{b}": iblank for b, iblank in enumerate(header.iblanks)})
    return {name: array for name, array in arrays.items() if array is not None}


def attributes_of(report: FitReport, **_: Any) -> dict[str, object]:
    """Attributes of a model's file except its checksum: data outside the model, such as the time of the fit."""
    return {"format": MODEL_FORMAT, "version": VERSION, "seconds": report.seconds}


def document_of(
    topology: Topology, mesh: BSplineMesh, header: GridHeader, report: FitReport, settings: FitSettings, **_: Any
) -> bytes:
    """All fields of a model that are not arrays, as JSON, without the time of the fit: equal fits are equal."""
    fields_of_document = {
        "topology": topology,
        "header": replace(header, iblanks=()),
        "report": replace(report, seconds=0.0),
        "settings": settings,
        "orders": tuple(volume.orders for volume in mesh.volumes),
    }
    return json.dumps(_encode(fields_of_document)).encode()


def _decode_of(file: h5py.File, document: dict) -> dict:
    """The document of a file, with the time of the fit, which is an attribute."""
    found = _decode(document)
    seconds = float(file.attrs.get("seconds", found["report"].seconds))
    return found | {"report": replace(found["report"], seconds=seconds)}


def _fields_of(document: dict, arrays: dict[str, np.ndarray]) -> dict[str, object]:
    """Small fields of a model, from document and arrays; ValueError if they do not fit together."""
    volumes = [
        Volume(tuple(knots_from_array(arrays[f"knots/{s}/{d}"], order) for d, order in enumerate(orders)))
        for s, orders in enumerate(document["orders"])
    ]
    ids, control_points = [arrays[f"control_ids/{s}"] for s in range(len(volumes))], arrays["control_points"]
    header, topology = document["header"], document["topology"]
    _check_topology(topology, header)
    if len(volumes) != len(topology.segments):
        raise ValueError("volumes")
    return {
        "topology": topology,
        "mesh": BSplineMesh(tuple(volumes), tuple(ids), len(control_points)),
        "control_points": control_points,
        "header": header,
        "report": document["report"],
        "settings": document["settings"],
        "candidate_weights": _checked_weights(arrays),
    }


def _checked_weights(arrays: dict[str, np.ndarray]) -> np.ndarray | None:
    """Weights of the candidates; ValueError unless each control point has all of them, with a sum of 1."""
    weights = arrays.get("shares")
    if weights is not None:
        if weights.shape != (len(arrays["control_points"]), len(CANDIDATES)):
            raise ValueError("weights")
        # they are sums and products of few numbers, so they sum to 1 up to round-off
        if not (np.abs(weights.sum(axis=1) - 1.0) <= 1e-9).all():
            raise ValueError("weights")
    return weights


def _checked_lengths(path: str | os.PathLike, arrays: dict[str, np.ndarray], is_turned: bool) -> np.ndarray | None:
    """Lengths of the residual around corners of spans; ValueError unless they are valid lengths."""
    lengths = arrays.get("residual_lengths")
    if lengths is None and is_turned:
        raise InputError(
            f"{path}: is of a version before 4, which only one process can read; fit the grid again, or rewrite the "
            f"file by FittedModel.load(path).save(path)"
        )
    if lengths is not None and (lengths.ndim != 1 or not (lengths >= 0.0).all()):
        raise ValueError("lengths")
    return lengths


def _check_topology(topology: Topology, header: GridHeader) -> None:
    """Raise ValueError unless every index is within the blocks and segments, and segments fill the blocks."""
    shapes = topology.shapes
    if not shapes or len(header.names) != len(shapes):
        raise ValueError("blocks")
    names = [header.source, topology.source, *header.names, *(patch.name for patch in header.patches)]
    declared = [(face.patch, face.kind) for face in topology.boundary if (face.patch, face.kind) != (None, None)]
    if not all(isinstance(name, str) for name in (*names, *(name for pair in declared for name in pair))):
        raise ValueError("names")
    for shape in shapes:
        _check_numbers(shape, 1, np.iinfo(np.int32).max)
    sides = [side for interface in topology.interfaces for side in (interface.a, interface.b)]
    misses = [side for miss in topology.near_misses for side in (miss.window, miss.other) if side is not None]
    patches = [window for patch in header.patches for window in patch.windows]
    boundary = [face.window for face in topology.boundary]
    for window in (*sides, *misses, *patches, *boundary, *topology.collapsed, *topology.segments):
        _check_window(window, shapes)
    for block, shape in enumerate(shapes):
        mine = [segment for segment in topology.segments if segment.block == block]
        n_cells = [math.prod(max(n - 1, 1) for n in one) for one in (shape, *(segment.shape for segment in mine))]
        if n_cells[0] != sum(n_cells[1:]) or any(a.overlaps(b) for a, b in combinations(mine, 2)):
            raise ValueError("segments")
    for interface in topology.interfaces:
        _check_orientation(interface.orientation, interface.a.shape, interface.b.shape)
    for collapse in topology.collapses:
        _check_numbers((collapse.direction,), 0, 2)
        _section_shape(topology, collapse.segment, collapse.section)
    for link in topology.alike:
        ends = ((link.a, link.a_section), (link.b, link.b_section))
        _check_orientation(link.orientation, *(_section_shape(topology, *end) for end in ends))


def _check_window(window: Window, shapes: Sequence[Sequence[int]]) -> None:
    _check_numbers((window.block,), 0, len(shapes) - 1)
    if len(window.lo) != 3 or len(window.hi) != 3:
        raise ValueError("window")
    for lo, hi, n in zip(window.lo, window.hi, shapes[window.block]):
        _check_numbers((lo,), 0, n - 1)
        _check_numbers((hi,), lo, n - 1)


def _section_shape(topology: Topology, number: int, section: Sequence[int | None]) -> list[int]:
    """Number of nodes in each direction of a section of a segment."""
    _check_numbers((number,), 0, len(topology.segments) - 1)
    if len(section) != 3 or any(end not in (0, -1, None) for end in section):
        raise ValueError("section")
    return [n if end is None else 1 for n, end in zip(topology.segments[number].shape, section)]


def _check_orientation(orientation: Orientation, shape: Sequence[int], other: Sequence[int]) -> None:
    """Raise ValueError unless it turns one shape into the other."""
    is_permutation = sorted(orientation.perm) == [0, 1, 2] and len(orientation.flip) == 3
    if not is_permutation or any(n != other[p] for n, p in zip(shape, orientation.perm)):
        raise ValueError("orientation")


def _check_numbers(numbers: Sequence[int], least: int, most: int) -> None:
    """Raise ValueError unless these are integers within limits."""
    if any(type(number) is not int or not least <= number <= most for number in numbers):
        raise ValueError("index")


def check_parameters(topology: Topology, number: int, shape: Sequence[int], values: np.ndarray | None = None) -> None:
    """Raise ValueError unless parameters match the nodes of a segment and their values are from 0 to 1."""
    if tuple(shape) != (*topology.segments[number].shape, 3):
        raise ValueError("parameters")
    if values is not None and not (np.abs(values - 0.5) <= 0.5 + 1e-9).all():
        raise ValueError("parameters")


def _encode(value: Any) -> Any:
    """Turn records, tuples and numbers into JSON types."""
    if is_dataclass(value):
        if type(value).__name__ not in _RECORDS:
            raise InputError(
                f"a {type(value).__name__} cannot be stored with a fitted model; read the grid from a file"
            )
        return {"record": type(value).__name__} | {f.name: _encode(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, dict):
        return {name: _encode(item) for name, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [_encode(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _decode(value: Any) -> Any:
    """Reverse of `_encode`; lists become tuples."""
    if isinstance(value, list):
        return tuple(_decode(item) for item in value)
    if isinstance(value, dict):
        items = {name: _decode(item) for name, item in value.items() if name != "record"}
        if "is_gzipped" in items:  # written before other compressions were supported
            items["compression"] = "gzip" if items.pop("is_gzipped") else ""
        return _RECORDS[value["record"]](**items) if "record" in value else items
    return value
