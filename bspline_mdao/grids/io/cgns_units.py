"""Units of the lengths in CGNS files: ``DimensionalUnits_t`` if the data are dimensional.

The innermost node counts, of coordinates, their group, the zone and the base. CGNS has no word for millimetres: such
files say ``UserDefined`` and store the unit as a text, ``LengthUnit``, in the base.

Format: ``docs/theory/grid_files.rst``, "Units".
"""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np

from ...errors import InputError
from .cgns_nodes import add_node, children, first_child, value, word

__all__ = ["add_unit", "read_unit"]

_OF_WORD = {"meter": "m", "centimeter": "cm", "millimeter": "mm", "inch": "in", "foot": "ft"}
_WORDS = {"m": "Meter", "cm": "Centimeter", "in": "Inch", "ft": "Foot"}

UNIT_TEXT = "LengthUnit"
"""Text (``Descriptor_t``) in the base for a unit that CGNS has no word for."""

_DIMENSIONAL = "Dimensional"
_UNKNOWN = "NormalizedByUnknownDimensional"
"""Class of data of new files without a unit: most converted grid files do not state theirs."""


def read_unit(source: str, zones: Sequence[tuple[h5py.Group, h5py.Group]]) -> str:
    """Find the unit of the lengths of some zones, each given with its base; empty if they have none."""
    found: dict[str, str] = {}
    for base, zone in zones:
        found.setdefault(_unit_of(base, zone), zone.name)
    if len(found) > 1:
        said = " and ".join(f"{unit or 'not stated'} in {name}" for unit, name in list(found.items())[:2])
        raise InputError(f"{source}: lengths are {said}; write all zones in one unit")
    return next(iter(found), "")


def _unit_of(base: h5py.Group, zone: h5py.Group) -> str:
    """Unit of the coordinates of a zone."""
    coordinates = first_child(zone, "GridCoordinates_t")
    arrays = [] if coordinates is None else [node for _, node in children(coordinates, "DataArray_t")][:1]
    inner_first = [*arrays, *([] if coordinates is None else [coordinates]), zone, base]
    classes = [first_child(node, "DataClass_t") for node in inner_first]
    data_class = next((word(node) for node in classes if node is not None), _DIMENSIONAL)
    units = [first_child(node, "DimensionalUnits_t") for node in inner_first]
    stated = next((node for node in units if node is not None), None)
    if stated is None or data_class != _DIMENSIONAL:
        return ""
    length = value(stated).tobytes()[32:64].decode("ascii", "replace").split("\0")[0].strip().lower()
    text = dict(children(base, "Descriptor_t")).get(UNIT_TEXT)
    return _OF_WORD.get(length) or (word(text) if text is not None and length == "userdefined" else "")


def add_unit(base: h5py.Group, unit: str) -> None:
    """Write the unit of lengths into a base without one; if it is empty, only that it is unknown."""
    for label in ("DataClass_t", "DimensionalUnits_t"):
        for name, _ in children(base, label):
            del base[name]
    add_node(base, "DataClass", "DataClass_t", _DIMENSIONAL if unit else _UNKNOWN)
    if not unit:
        return
    words = "Null", _WORDS.get(unit, "UserDefined"), "Null", "Null", "Null"
    letters = np.frombuffer("".join(each.ljust(32) for each in words).encode(), np.int8).reshape(5, 32)
    stored = add_node(base, "DimensionalUnits", "DimensionalUnits_t", "x")
    del stored[" data"]
    stored.create_dataset(" data", data=letters)
    if unit not in _WORDS:
        add_node(base, UNIT_TEXT, "Descriptor_t", unit)
