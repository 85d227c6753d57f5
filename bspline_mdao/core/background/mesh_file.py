"""One HDF5 file for an unstructured mesh that is ready to move.

Layout, version 1::

    /                       attributes: format, version, checksum, mesh_file
    /document               JSON (UTF-8): kinds of the markers, settings of the lattice, name and unit of the mesh
    /points                 (n, 3) nodes (m)
    /cells/<kind>           corners of the cells of each kind
    /markers/<n>            (n_faces, 4) faces of the markers, in the order of the document
    /faces, /face_cells     faces of polyhedra and their cells, where there are some
    /numbers                (n_file,) node of the mesh for each node of the file, for a grid of blocks

Lattice, planes and everything else are rebuilt from these. The mesh's own file, which receives moved nodes in place, is
not included, only its path.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np

from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.io.disk import deferred_interrupts, replaced_hdf5_file
from ...grids.io.formats import MESH_MODEL_FORMAT
from ..model.model_file import (
    checked_document,
    checksum_of,
    damaged_is_input_error,
    dataset_options,
    datasets_of,
)
from .lattice_settings import LatticeSettings

__all__ = ["is_mesh_model", "mesh_file_in", "read_mesh_model", "write_mesh_model"]

VERSION = 1


def is_mesh_model(path: str | os.PathLike) -> bool:
    """Whether a file is a model of an unstructured mesh."""
    if not Path(path).is_file() or not h5py.is_hdf5(path):
        return False
    with h5py.File(path, "r") as file:
        return file.attrs.get("format") == MESH_MODEL_FORMAT


def mesh_file_in(path: str | os.PathLike) -> str:
    """Name of the mesh's own file as stored in the model; empty if there is none."""
    with h5py.File(path, "r") as file:
        return str(file.attrs.get("mesh_file", ""))


def arrays_of(mesh: MixedMesh) -> dict[str, np.ndarray]:
    """Arrays of a mesh by their names in the file."""
    arrays = {"points": mesh.points} | {f"cells/{kind}": corners for kind, corners in mesh.cells.items()}
    arrays |= {f"markers/{n}": faces for n, faces in enumerate((mesh.markers or {}).values())}
    if mesh.polyhedra is not None:
        arrays["faces"], arrays["face_cells"] = mesh.polyhedra
    if mesh.numbers is not None:
        arrays["numbers"] = mesh.numbers
    return arrays


def document_of(mesh: MixedMesh, kinds: dict[str, str], settings: LatticeSettings) -> bytes:
    """All non-array data of a model, as JSON."""
    names = list(mesh.markers or {})
    fields = {"source": mesh.source, "n_copies": mesh.n_copies, "markers": names, "cells": list(mesh.cells)}
    fields |= {"unit": mesh.unit} if mesh.unit else {}
    return json.dumps(fields | {"kinds": kinds, "settings": asdict(settings)}).encode()


def write_mesh_model(
    path: str | os.PathLike,
    mesh: MixedMesh,
    kinds: dict[str, str],
    settings: LatticeSettings,
    mesh_file: str,  # the mesh's own file
    compress: bool = True,
) -> None:
    """Write a model; an existing file is replaced only when the new one is complete."""
    arrays, document = arrays_of(mesh), document_of(mesh, kinds, settings)
    options = dataset_options(compress)
    with replaced_hdf5_file(path) as file:
        checksum = checksum_of(document, arrays)
        with deferred_interrupts():
            file.attrs.update(
                {"format": MESH_MODEL_FORMAT, "version": VERSION, "checksum": checksum, "mesh_file": mesh_file}
            )
            file["document"] = np.frombuffer(document, np.uint8)
        for name, array in arrays.items():
            with deferred_interrupts():
                file.create_dataset(name, data=array, **options)


def read_mesh_model(path: str | os.PathLike) -> tuple[MixedMesh, dict[str, str], LatticeSettings, str]:
    """Read the mesh, the kinds of its markers, the settings of the lattice, and the name of the mesh's own file."""
    if not is_mesh_model(path):
        raise InputError(f"{path}: is no model of a lattice around a mesh; make one with the command fit")
    with damaged_is_input_error(path, "the model of a mesh is damaged; fit the mesh again"):
        with deferred_interrupts(), h5py.File(path, "r") as file:
            if file.attrs["version"] > VERSION:
                raise InputError(
                    f"{path}: is of version {file.attrs['version']}, newer than {VERSION}; update the program"
                )
            arrays = datasets_of(path, file)
            document, mesh_file = checked_document(file, arrays), str(file.attrs["mesh_file"])
            stored = {name: array[()] for name, array in arrays.items()}
        cells = {kind: stored[f"cells/{kind}"] for kind in document["cells"]}
        markers = {name: stored[f"markers/{n}"] for n, name in enumerate(document["markers"])}
        polyhedra = (stored["faces"], stored["face_cells"]) if "faces" in stored else None
        points, source, n_copies = stored["points"], document["source"], document["n_copies"]
        numbers, unit = stored.get("numbers"), document.get("unit", "")
        mesh = MixedMesh(points, cells, markers, polyhedra, source, n_copies, numbers=numbers, unit=unit)
        settings = document["settings"]
        settings["refined"] = tuple(tuple(part) for part in settings.get("refined", ()))
        return mesh, document["kinds"], LatticeSettings(**settings), mesh_file
