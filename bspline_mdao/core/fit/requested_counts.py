"""Numbers of control points that a user requests: for all blocks, for each, or for some by number or name.

Theory: ``docs/theory/fit.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import InputError
from ...grids.topology.topology import Topology


@dataclass(frozen=True, eq=False)
class RequestedCounts:
    """Requests for every block."""

    counts: np.ndarray  # int (n_blocks, 3), control points per direction; 0 if they are to be chosen
    is_named: np.ndarray  # bool (n_blocks,), whether the block has its own request, not one for all others

    @property
    def is_complete(self) -> bool:
        """Whether nothing remains to be chosen."""
        return bool(self.counts.all())

    @classmethod
    def of(
        cls,
        # for all blocks; for each, where None leaves a block to be chosen; or by numbers from 1 or names of blocks,
        # where the key None means all others. None chooses all
        n_control: Any,  # None, int, triple of int, sequence of (triple or None), mapping, or RequestedCounts
        topology: Topology,  # segments and links
        names: Sequence[str] = (),  # names of the blocks, if these may be used
    ) -> RequestedCounts:
        """Interpret a request; `InputError` if there is no such block, or the request is not made of numbers."""
        if isinstance(n_control, RequestedCounts):
            return n_control
        n_blocks = len(topology.shapes)
        if isinstance(n_control, Mapping):
            return cls._of_mapping(n_control, topology, names)
        if isinstance(n_control, Sequence) and len(n_control) == n_blocks and any(item is None for item in n_control):
            given = {number: item for number, item in enumerate(n_control, start=1) if item is not None}
            return cls._of_mapping(given, topology, names)
        if n_control is None:
            return cls(np.zeros((n_blocks, 3), dtype=int), np.zeros(n_blocks, dtype=bool))
        counts = per_block(n_control, topology, "n_control")
        return cls(counts, np.full(n_blocks, np.ndim(n_control) == 2))

    @classmethod
    def _of_mapping(cls, given: Mapping, topology: Topology, names: Sequence[str]) -> RequestedCounts:
        n_blocks = len(topology.shapes)
        counts, is_named = np.zeros((n_blocks, 3), dtype=int), np.zeros(n_blocks, dtype=bool)
        if given.get(None) is not None:
            counts[:] = per_block(given[None], topology, "n_control")
        for key, value in given.items():
            if key is not None:
                block = _block_of(key, topology, names)
                if is_named[block]:
                    raise InputError(f"{topology.source}: n_control has block {block + 1} twice; give it once")
                counts[block] = per_block(value, topology, "n_control")[block]
                is_named[block] = True
        return cls(counts, is_named)


def per_block(value: Any, topology: Topology, name: str) -> np.ndarray:
    """Expand a number, a triple or one triple per block to an array of shape (n_blocks, 3)."""
    n_blocks = len(topology.shapes)
    try:
        array = np.asarray(value)
        if array.ndim == 2 and len(array) != n_blocks:
            raise ValueError
        array = np.broadcast_to(array, (n_blocks, 3))
    except ValueError:
        raise InputError(
            f"{topology.source}: {name} = {value} does not fit {n_blocks} blocks; give three numbers, or three for each"
        ) from None
    if not np.issubdtype(array.dtype, np.integer) or array.min() < 1:
        raise InputError(f"{topology.source}: {name} = {value}; give whole numbers of at least 1")
    return array


def _block_of(key: Any, topology: Topology, names: Sequence[str]) -> int:
    """Number, from 0, of a block by its name, or by its number from 1."""
    n_blocks = len(topology.shapes)
    if key in names:
        if names.count(key) > 1:
            raise InputError(f"{topology.source}: several blocks are named {key}; give the number of one of them")
        return names.index(key)
    try:
        number = int(key)
    except (TypeError, ValueError):
        number = 0
    if not 1 <= number <= n_blocks:
        named = f" or a name, such as {names[0]}" if names else ""
        raise InputError(f"{topology.source}: n_control of block {key}; give a number from 1 to {n_blocks}{named}")
    return number - 1
