"""Families of CGNS files: names and types of parts of the boundary.

A condition names its family; a family inside another is named by its path below the base, ``wing/upper``, also with the
base, ``/Base/wing/upper``. A family without a kind has the kind of the family around it. Further families of a
condition are in ``AdditionalFamilyName_t``; the first of them is used if there is no other.

Format: ``docs/theory/grid_files.rst``.
"""

from __future__ import annotations

from typing import NamedTuple

import h5py

from .cgns_nodes import children, first_child, word

__all__ = ["BC_OVERSET", "ORIGINAL_NAME", "TYPES_THAT_SAY_NOTHING", "Families", "Meaning"]

ORIGINAL_NAME = "OriginalName"
"""Text (``Descriptor_t``) in a family whose patch has an invalid node name: too long, or with a slash."""

TYPES_THAT_SAY_NOTHING = ("", "Null", "UserDefined", "BCTypeNull", "BCTypeUserDefined")

BC_OVERSET = "BCOverset"
"""Text next to a condition or family of a type that CGNS does not have (``UserDefinedData_t``): ADflow, pyHyp and
cgnsutilities declare outer boundaries of overset component grids in this way."""

_DEEPEST = 8  # nested families, so that circular links end


class Meaning(NamedTuple):
    """Meaning of a boundary condition."""

    name: str  # name of its patch: the family's, or else its own
    bc_type: str  # type of the condition, or of its family
    others: tuple[str, ...]  # further families that it belongs to


class Families:
    """Families of the bases of a file, each base read once."""

    def __init__(self) -> None:
        self._known: dict[str, dict[str, h5py.Group]] = {}

    def of(self, base: h5py.Group) -> dict[str, h5py.Group]:
        """Families of a base by their paths, each before those inside it."""
        if base.name not in self._known:
            found: dict[str, h5py.Group] = {}
            _add_below(base, "", found, depth=0)
            self._known[base.name] = found
        return self._known[base.name]

    def meaning_of(self, base: h5py.Group, name: str, condition: h5py.Group) -> Meaning:
        """Return the meaning of a condition of a zone in a base, through its families if it has some."""
        labels = "FamilyName_t", "AdditionalFamilyName_t"
        texts = [word(node) for label in labels for _, node in children(condition, label)]
        places = [self._place(base, text) for text in texts if text]
        bc_type = word(condition)
        if bc_type == "FamilySpecified":
            types = [_type_of(families, path) for families, path in places]
            bc_type = next((each for each in types if each not in TYPES_THAT_SAY_NOTHING), types[0] if types else "")
        names = [_name_of(families, path) for families, path in places]
        if bc_type in (*TYPES_THAT_SAY_NOTHING, "FamilySpecified"):
            families_of_it = [families[path] for families, path in places if path in families]
            if any(BC_OVERSET in dict(children(node, "UserDefinedData_t")) for node in (condition, *families_of_it)):
                bc_type = BC_OVERSET
        return Meaning(names[0] if names else name, bc_type, tuple(names[1:]))

    def _place(self, base: h5py.Group, text: str) -> tuple[dict[str, h5py.Group], str]:
        """Families of the base to which a name belongs, and its path among them."""
        parts = [part for part in text.split("/") if part]
        if text.startswith("/") and len(parts) > 1:
            bases = dict(children(base.parent, "CGNSBase_t"))
            if parts[0] in bases:
                return self.of(bases[parts[0]]), "/".join(parts[1:])
        families, base_name = self.of(base), base.name.rpartition("/")[2]
        is_with_base = len(parts) > 1 and parts[0] == base_name and parts[0] not in families
        return families, "/".join(parts[is_with_base:])


def _add_below(parent: h5py.Group, path: str, found: dict[str, h5py.Group], depth: int) -> None:
    """Add the families in a base or a family, whose path ends with a slash."""
    if depth > _DEEPEST:
        raise KeyError(f"families at {path} are in more than {_DEEPEST} others")
    for name, node in children(parent, "Family_t"):
        found[f"{path}{name}"] = node
        _add_below(node, f"{path}{name}/", found, depth + 1)


def _type_of(families: dict[str, h5py.Group], path: str) -> str:
    """Type of the condition of a family, or of the innermost family around it that has one."""
    while path:
        family_bc = first_child(families[path], "FamilyBC_t") if path in families else None
        if family_bc is not None:
            return word(family_bc)
        path = path.rpartition("/")[0]
    return ""


def _name_of(families: dict[str, h5py.Group], path: str) -> str:
    """Name of the patch of a family: the original, if it could not be the name of a node."""
    texts = dict(children(families[path], "Descriptor_t")) if path in families else {}
    return word(texts[ORIGINAL_NAME]) if ORIGINAL_NAME in texts else path
