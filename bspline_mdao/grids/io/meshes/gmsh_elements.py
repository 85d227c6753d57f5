"""Elements of Gmsh's files, format 2.2 and 4.1, in ASCII and binary, and their physical groups.

Format: the reference manual of Gmsh, section "Gmsh file formats".
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from .gmsh_sections import BinaryNumbers, GmshFile
from .text_numbers import integers_by_line

__all__ = ["Block", "find_gmsh_elements", "physical_names"]

KINDS = {
    "vertex": (0, 1, {15: 1}),
    "line": (1, 2, {1: 2, 8: 3, 26: 4, 27: 5, 28: 6, 62: 7, 63: 8, 64: 9, 65: 10, 66: 11}),
    "triangle": (2, 3, {2: 3, 9: 6, 21: 10, 23: 15, 25: 21, 42: 28, 43: 36, 44: 45, 45: 55, 46: 66}),
    "quad": (2, 4, {3: 4, 10: 9, 36: 16, 37: 25, 38: 36, 47: 49, 48: 64, 49: 81, 50: 100, 51: 121}),
    "tetra": (3, 4, {4: 4, 11: 10, 29: 20, 30: 35, 31: 56, 71: 84, 72: 120, 73: 165, 74: 220, 75: 286}),
    "hexahedron": (3, 8, {5: 8, 12: 27, 92: 64, 93: 125, 94: 216, 95: 343, 96: 512, 97: 729, 98: 1000}),
    "wedge": (3, 6, {6: 6, 13: 18, 90: 40, 91: 75, 106: 126, 107: 196, 108: 288, 109: 405, 110: 550}),
    "pyramid": (3, 5, {7: 5, 14: 14, 118: 30, 119: 55, 120: 91, 121: 140, 122: 204, 123: 285, 124: 385}),
}
KINDS["triangle"][2].update({20: 9, 22: 12, 24: 15, 52: 18, 53: 21, 54: 24, 55: 27, 56: 30})
KINDS["quad"][2].update({16: 8, 39: 12, 40: 16, 41: 20, 57: 24, 58: 28, 59: 32, 60: 36, 61: 40})
KINDS["tetra"][2].update({137: 16, 32: 22, 33: 28, 79: 34, 80: 40, 81: 46, 82: 52, 83: 58})
KINDS["hexahedron"][2].update({17: 20, 99: 32, 100: 44, 101: 56, 102: 68, 103: 80, 104: 92, 105: 104})
KINDS["wedge"][2].update({18: 15})
KINDS["pyramid"][2].update({19: 13, 125: 21, 126: 29, 127: 37, 128: 45, 129: 53, 130: 61, 131: 69})
"""Dimension and corners of elements, which come first, and the nodes of each of Gmsh's types of them: of degree 1, 2
and so on, and types without inner nodes."""

NODES = {number: n for _, _, numbers in KINDS.values() for number, n in numbers.items()}
OF_TYPE = {number: (kind, dimension, n) for kind, (dimension, n, numbers) in KINDS.items() for number in numbers}

_NAME = re.compile(rb"\s*(\d)\s+(-?\d{1,18})\s+\"([^\"\n]*)\"[ \t\r]*\n")


@dataclass(frozen=True, eq=False)
class Block:
    """Elements of one type."""

    kind: str  # their kind, see `KINDS`
    dimension: int  # its dimension
    corners: np.ndarray  # (n, n_corners) of int, numbers of their corners as in the file
    groups: np.ndarray  # (n, n_groups) of int, physical groups of each; 0 for none

    @classmethod
    def of(cls, number: int, nodes: np.ndarray, groups: np.ndarray) -> Block:
        """Take the corners of elements of a type from all their nodes."""
        kind, dimension, n_corners = OF_TYPE[number]
        return cls(kind, dimension, nodes[:, :n_corners], np.abs(groups))


def find_gmsh_elements(file: GmshFile) -> list[Block]:
    """Find the elements of a file."""
    if not file.is_old:
        return _by_entity(file)
    n, start = file.counted("Elements")
    span = start, file.sections["Elements"][1]
    blocks = _old_binary(BinaryNumbers(file, *span), n) if file.is_binary else _old_text(file, span)
    n_found = sum(len(block.corners) for block in blocks)
    if n_found != n:
        raise ValueError(f"it announces {n} elements and holds {n_found}")
    return blocks


def physical_names(file: GmshFile) -> dict[tuple[int, int], str]:
    """Names of physical groups by their dimensions and numbers; ValueError if they are damaged."""
    if "PhysicalNames" not in file.sections:
        return {}
    (n, at), stop = file.counted("PhysicalNames"), file.sections["PhysicalNames"][1]
    names, n_found = {}, 0
    while found := _NAME.match(file.data, at, stop):
        names[int(found[1]), int(found[2])] = found[3].decode(errors="backslashreplace")
        at, n_found = found.end(), n_found + 1
    if not len(names) == n_found == n or file.data[at:stop].strip():
        raise ValueError(f"it announces {n} physical names and holds {n_found}")
    return names


def _nodes_of(number: int) -> int:
    """Number of nodes of an element of a type."""
    if number not in NODES:
        raise ValueError(f"elements of type {number}, which is not known")
    return NODES[number]


def _by_entity(file: GmshFile) -> list[Block]:
    """Elements of version 4.1, entity after entity."""
    groups, numbers = _groups_of_entities(file), file.numbers("Elements")
    n_entities, n_elements, _, _ = numbers.take("size", 4).tolist()
    blocks = []
    for _ in range(n_entities):
        dimension, tag, number = numbers.take("int", 3).tolist()
        n, n_nodes = int(numbers.take("size", 1)[0]), _nodes_of(number)
        if OF_TYPE[number][1] != dimension or (groups is not None and (dimension, tag) not in groups):
            raise ValueError(
                f"elements of type {number} of entity {tag} of dimension {dimension}, which does not exist"
            )
        found = numbers.take("size", n * (1 + n_nodes)).reshape(n, 1 + n_nodes)
        of_all = np.array((groups or {}).get((dimension, tag), []), dtype=np.int64)
        blocks.append(Block.of(number, found[:, 1:], np.broadcast_to(of_all, (n, len(of_all)))))
    numbers.require_end()
    n_found = sum(len(block.corners) for block in blocks)
    if n_found != n_elements:
        raise ValueError(f"it announces {n_elements} elements and holds {n_found}")
    return blocks


def _groups_of_entities(file: GmshFile) -> dict[tuple[int, int], list[int]] | None:
    """Physical groups of every entity by its dimension and number; None if there are no entities."""
    if "Entities" not in file.sections:
        return None
    numbers, groups = file.numbers("Entities"), {}
    for dimension, n in enumerate(numbers.take("size", 4).tolist()):
        for _ in range(n):
            tag = int(numbers.take("int", 1)[0])
            numbers.take("real", 6 if dimension else 3)
            groups[dimension, tag] = numbers.take("int", int(numbers.take("size", 1)[0])).tolist()
            if dimension:
                numbers.take("int", int(numbers.take("size", 1)[0]))
    numbers.require_end()
    return groups


def _old_binary(numbers: BinaryNumbers, n: int) -> list[Block]:
    """Elements of version 2.2, type after type."""
    blocks: list[Block] = []
    n_found = 0
    while n_found < n:
        number, n_here, n_tags = numbers.take("int", 3).tolist()
        n_nodes = _nodes_of(number)
        if n_here < 1 or n_tags < 0:
            raise ValueError(f"{n_here} elements with {n_tags} numbers each")
        found = numbers.take("int", n_here * (1 + n_tags + n_nodes)).reshape(n_here, -1)
        blocks.append(Block.of(number, found[:, 1 + n_tags :], found[:, 1 : 1 + min(n_tags, 1)]))
        n_found += n_here
    numbers.require_end()
    return blocks


def _old_text(file: GmshFile, span: tuple[int, int]) -> list[Block]:
    """Elements of version 2.2, one per line, type after type."""
    numbers, starts = integers_by_line(file.data[slice(*span)], file.source)
    starts, sizes = starts[:-1], np.diff(starts)
    if (sizes < 4).any():
        raise ValueError(f"element {int(np.argmax(sizes < 4)) + 1} has too few numbers")
    types, n_tags = numbers[starts + 1], numbers[starts + 2]
    blocks = []
    _, firsts = np.unique(types, return_index=True)
    for number in types[np.sort(firsts)].tolist():
        rows, n_nodes = np.flatnonzero(types == number), _nodes_of(number)
        is_wrong = (n_tags[rows] < 0) | (sizes[rows] - 3 - n_nodes != n_tags[rows])
        if is_wrong.any():
            raise ValueError(f"element {int(rows[np.argmax(is_wrong)]) + 1} has not the numbers of its type {number}")
        ends = starts[rows] + sizes[rows]
        groups = np.where(n_tags[rows] > 0, numbers[starts[rows] + 3], 0)
        blocks.append(Block.of(number, numbers[ends[:, None] - n_nodes + np.arange(n_nodes)], groups[:, None]))
    return blocks
