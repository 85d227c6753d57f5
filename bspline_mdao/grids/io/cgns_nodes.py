"""CGNS nodes as HDF5 stores them.

A node is an HDF5 group with the attributes ``name``, ``label`` and ``type``; its value is the dataset ``" data"``, its
children are the groups in it. A link is a group of type ``LK`` with the HDF5 link ``" link"``.

Theory: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import h5py
import numpy as np

from ...base.text import reason_of
from ...errors import InputError
from .disk import MAX_RATIO, MAX_SMALL

__all__ = [
    "add_node",
    "children",
    "damaged_is_input_error",
    "first_child",
    "follow_link",
    "free_name",
    "is_link",
    "label",
    "require_stored",
    "value",
    "whole_numbers",
    "word",
]

_MAX_LINKS = 8  # consecutive links, so that circular ones end
_DAMAGE = (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, ArithmeticError, MemoryError)


@contextmanager
def damaged_is_input_error(source: str) -> Iterator[None]:
    """Turn any error of h5py on a damaged file into an `InputError` of one line."""
    try:
        yield
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(
            f"{source}: damaged or incomplete CGNS/HDF5 file ({reason_of(error)}); write it again"
        ) from error


def label(group: h5py.Group) -> str:
    """CGNS label of a node, such as ``"Zone_t"``; empty if it has none."""
    return _text(group.attrs.get("label", b""))


def is_link(group: h5py.Group) -> bool:
    """Whether the node refers to one elsewhere, in this file or another."""
    return _text(group.attrs.get("type", b"")) == "LK"


def follow_link(group: h5py.Group) -> h5py.Group:
    """Return the node itself or, for a link, its target."""
    for _ in range(_MAX_LINKS):
        if not is_link(group):
            return group
        target = group.get(" link")
        if not isinstance(target, h5py.Group):
            raise KeyError(f"the file or node linked to at {group.name} is missing")
        group = target
    raise KeyError(f"the link at {group.name} leads nowhere")


def children(group: h5py.Group, wanted: str) -> list[tuple[str, h5py.Group]]:
    """Name and node of all children with label ``wanted``, links followed."""
    # They come in the order of creation if the file keeps it, as in the CGNS library, and otherwise in the natural
    # order of their names.
    found = []
    for name in group if _keeps_creation_order(group) else sorted(group, key=_natural_order):
        if group.get(name, getclass=True) is h5py.Group:
            node = follow_link(group[name])
            if label(node) == wanted:
                found.append((name, node))
    return found


def first_child(group: h5py.Group, wanted: str) -> h5py.Group | None:
    """Return the first child with label ``wanted``, or None."""
    return next((node for _, node in children(group, wanted)), None)


def names_of_families(base: h5py.Group) -> dict[str, tuple[str, ...]]:
    """Names to which the families of a base refer, if these are not families of it themselves."""
    # Gmsh writes a family for each of its curves and surfaces and their physical names in it. If a name is another
    # family's, the families are parts of that family, and keep their own names.
    families = dict(children(base, "Family_t"))
    found = {}
    for family, node in families.items():
        names = (word(name) for _, name in children(node, "FamilyName_t"))
        if others := tuple(name for name in names if name and name not in families):
            found[family] = others
    return found


def value(group: h5py.Group) -> np.ndarray:
    """Value of a node, as stored: the first index of CGNS is the last here."""
    require_stored(group)
    return group[" data"][()]


def whole_numbers(group: h5py.Group) -> np.ndarray:
    """Value of a node with whole numbers, in sequence, shape (n,)."""
    found = np.asarray(value(group))
    if found.dtype.kind not in "iu":
        raise InputError(
            f"{group.file.filename}: {group.name} is of {found.dtype}, instead of whole numbers; write it again"
        )
    return found.ravel().astype(np.int64)


def require_stored(group: h5py.Group) -> None:
    """Refuse a node whose value claims to be larger than its file can contain."""
    data = group[" data"]
    name = data.file.filename  # none on disk if an older format was copied in memory
    n_bytes = os.path.getsize(name) if os.path.isfile(name) else data.file.id.get_filesize()
    claimed = float(np.prod([float(n) for n in data.shape])) * data.dtype.itemsize
    if claimed > max(MAX_SMALL, MAX_RATIO * n_bytes):
        raise InputError(
            f"{data.file.filename}: {group.name} claims {claimed:.3g} bytes, the file holds {n_bytes}; write it again"
        )


def word(group: h5py.Group) -> str:
    """Value of a node with characters; empty if it has none."""
    if " data" not in group:
        return ""
    return value(group).tobytes().decode(errors="replace").split("\x00")[0].strip()


def _text(attribute: Any) -> str:
    """Text of an attribute up to its first zero byte, in any storage."""
    raw = attribute if isinstance(attribute, (bytes, str)) else np.asarray(attribute).tobytes()
    text = raw if isinstance(raw, str) else raw.decode("ascii", "replace")
    return text.split("\x00")[0]


def _keeps_creation_order(group: h5py.Group) -> bool:
    """Whether the file keeps the creation order of the children of a node."""
    properties = group["."].id.get_create_plist()
    return bool(properties.get_link_creation_order() & h5py.h5p.CRT_ORDER_TRACKED)


def _natural_order(name: str) -> list[tuple[bool, int | str]]:
    """Sort key that puts ``Zone 9`` before ``Zone 10``."""
    return [
        (not part.isdecimal(), int(part[:18]) if part.isdecimal() else part)
        for part in re.split(r"(\d+)", name)
        if part
    ]


def free_name(parent: h5py.Group, name: str) -> str:
    """Return an allowed, unused node name similar to ``name`` below ``parent``."""
    name = name.encode("ascii", "replace").decode().replace("/", "_").strip()[:32].strip() or "unnamed"
    stem, number = name, 1
    while name in parent:
        number += 1
        name = f"{stem[: 31 - len(str(number))]}_{number}"
    return name


def add_node(
    parent: h5py.Group,  # parent node, or the file
    name: str,  # name, at most 32 characters of ASCII
    label: str,  # CGNS label
    # value: int32, int64, float32, float64 (first index of CGNS last) or characters
    data: np.ndarray | str | None = None,
) -> h5py.Group:  # the new node
    """Add a node below ``parent``."""
    group = parent.create_group(name, track_order=True)
    kind = "MT"
    if isinstance(data, str):
        kind, data = "C1", np.frombuffer(data.encode(), np.int8)
    elif data is not None:
        kind = {"i": "I", "f": "R"}[data.dtype.kind] + str(data.dtype.itemsize)
    set_attributes(group, name, label, kind)
    if data is not None:
        group.create_dataset(" data", data=data)
    return group


def set_attributes(group: h5py.Group, name: str, label: str, kind: str) -> None:
    """Set the attributes that every node has, with the lengths that the CGNS library expects."""
    group.attrs.create("name", np.bytes_(name), dtype="S33")
    group.attrs.create("label", np.bytes_(label), dtype="S33")
    group.attrs.create("type", np.bytes_(kind), dtype="S3")
    group.attrs.create("flags", np.array([1], np.int32))


def set_root_attributes(file: h5py.File) -> None:
    """Write the CGNS library's attributes at the root of an HDF5 file."""
    set_attributes(file, "HDF5 MotherNode", "Root Node of HDF5 File", "MT")
    del file.attrs["flags"]
    file[" format"] = np.frombuffer(b"IEEE_LITTLE_32\0", np.int8)
    version = "HDF5 Version " + h5py.version.hdf5_version
    file[" hdf5version"] = np.frombuffer(version.encode().ljust(33, b"\0"), np.int8)
