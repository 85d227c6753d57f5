"""Entry point of frameworks: a chain at batches of arrays, with a cache of its last points.

Frameworks request values first and products with derivatives later, at the same arrays, and do not keep the chain's
state in between. So the last points are cached, and found again by the bits of their arrays: a product at a cached
point costs the same as the component's own. Batches are leading axes, of one size, or of length 1 for arrays common to
all. Control meshes of a batch move together, and so do products with their derivative: several right-hand sides for one
factor. Grids, which take more memory, follow one by one.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from hashlib import blake2b
from typing import Any

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from .chain import Arrays, Chain, ChainPlace, Shapes

__all__ = ["Batches"]

Tuple = tuple[np.ndarray, ...]
"""Arrays in the order of the chain's names."""


class Batches(OneLine):
    """A chain for batches of arrays."""

    def __init__(self, chain: Chain, takes_names: bool, gives_names: bool, memory: int = 1) -> None:
        if isinstance(memory, bool) or not isinstance(memory, int) or memory < 1:
            raise InputError(f"memory={memory!r}; give the number of designs to keep, from 1")
        self.chain, self.memory = chain, memory
        self.takes_names, self.gives_names = takes_names, gives_names
        self._places: OrderedDict[bytes, ChainPlace] = OrderedDict()
        self._lock = threading.RLock()

    @property
    def inputs(self) -> Shapes:
        """Names and shapes of the function's inputs."""
        return self.chain.inputs

    @property
    def outputs(self) -> Shapes:
        """Names and shapes of its outputs."""
        return self.chain.outputs

    def taken(self, given: Any) -> list:
        """The user's argument, an array or arrays by name, in the order of `inputs`."""
        if not self.takes_names:
            return [given]
        if not isinstance(given, dict):
            raise InputError(f"the function takes values by names, {', '.join(self.inputs)}; give a dict of arrays")
        wrong = sorted(set(given) ^ set(self.inputs))
        if wrong:
            raise InputError(f"'{wrong[0]}' is missing or unknown; give arrays of {', '.join(self.inputs)}")
        return [given[name] for name in self.inputs]

    def returned(self, found: Sequence) -> Any:
        """The user's result from arrays in the order of `outputs`."""
        return dict(zip(self.outputs, found)) if self.gives_names else found[0]

    def require_shapes(self, shapes: Sequence[tuple[int, ...]]) -> None:
        """Refuse arguments whose shapes differ from `inputs`."""
        for (name, shape), found in zip(self.inputs.items(), shapes):
            if tuple(found) != shape:
                raise InputError(f"'{name}' is of shape {tuple(found)}; give shape {shape}")

    def values(self, batch: tuple[int, ...], points: Sequence[np.ndarray]) -> Tuple:
        """Evaluate the chain at a batch of points."""

        def values_at(keys: list[bytes], places: list[ChainPlace], _: list[Arrays]) -> Iterator[Arrays]:
            return (self._finished(key, place).values for key, place in zip(keys, places))

        return self._over(batch, points, {}, [], self.outputs, values_at)

    def products(
        self,
        batch: tuple[int, ...],  # lengths of the leading axes
        points: Sequence[np.ndarray],  # where the derivative is taken
        vectors: Sequence[np.ndarray],  # changes of all inputs of the chain, or cotangents of all outputs
        is_transposed: bool,
    ) -> Tuple:
        """Multiply vectors with the derivative, or with its transpose."""
        if is_transposed:
            return self._over(batch, points, self.outputs, vectors, self.inputs, self._vjps)
        return self._over(batch, points, self.inputs, vectors, self.outputs, self._jvps)

    def _jvps(self, keys: list[bytes], places: list[ChainPlace], along: list[Arrays]) -> Iterator[Arrays]:
        """Products at points: the lead of all together, the rest one after the other."""
        lead = self.chain.lead_jvps(places, along)
        return (self._finished(key, place).rest_jvp(change) for key, place, change in zip(keys, places, lead))

    def _vjps(self, keys: list[bytes], places: list[ChainPlace], along: list[Arrays]) -> list[Arrays]:
        """Transpose of `_jvps`."""
        back = [self._finished(key, place).rest_vjp(bars) for key, place, bars in zip(keys, places, along)]
        return self.chain.lead_vjps(places, back)

    def _over(
        self,
        batch: tuple[int, ...],
        points: Sequence[np.ndarray],  # all inputs of the chain
        along: Shapes,  # names and shapes of further arrays of each batch member
        vectors: Sequence[np.ndarray],  # these arrays
        given: Shapes,
        work: Callable[[list[bytes], list[ChainPlace], list[Arrays]], Iterable[Arrays]],
    ) -> Tuple:
        """Work through a batch, with as many of its points together as the chain allows."""
        n = int(np.prod(batch, dtype=int))
        at, by = self._rows(batch, self.inputs, points), self._rows(batch, along, vectors)
        found = {name: np.empty((n, *shape)) for name, shape in given.items()}
        is_one_place, m = all(len(array) == 1 for array in at.values()), self.chain.n_together
        with self._lock:
            keys, places = self._begun([_row(at, 0)] if n and is_one_place else [])
            for first in range(0, n, m):
                members = range(first, min(n, first + m))
                if is_one_place:
                    keys, places = keys[:1] * len(members), places[:1] * len(members)
                else:
                    keys, places = self._begun([_row(at, i) for i in members])
                parts = iter(work(keys, places, [_row(by, i) for i in members]))
                for i in members:
                    _put(next(parts), found, i)  # none is kept while the next is made
        return tuple(found[name].reshape((*batch, *shape)) for name, shape in given.items())

    def _rows(self, batch: tuple[int, ...], shapes: Shapes, arrays: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
        """Arrays with one leading axis, of length 1 or the batch size."""
        rows = {}
        for (name, shape), array in zip(shapes.items(), arrays):
            array = np.asarray(array, dtype=float)
            leading = array.shape[: array.ndim - len(shape)]
            if int(np.prod(leading, dtype=int)) > 1:
                array = np.broadcast_to(array, (*batch, *shape))
            rows[name] = array.reshape(-1, *shape)
        return rows

    def _begun(self, batch: list[Arrays]) -> tuple[list[bytes], list[ChainPlace]]:
        """Keys and chain states of points: cached ones, and leads of the others, each once."""
        keys = [_key(points) for points in batch]
        places = {key: self._places[key] for key in keys if key in self._places}
        new = {key: points for key, points in zip(keys, batch) if key not in places}
        if new:
            copies = [{name: array.copy() for name, array in points.items()} for points in new.values()]
            places |= zip(new, self.chain.begun(copies))
        return keys, [places[key] for key in keys]

    def _finished(self, key: bytes, place: ChainPlace) -> ChainPlace:
        """Take the cached state, or finish this one and cache it."""
        if key not in self._places:
            while len(self._places) >= self.memory:
                self._places.popitem(last=False)  # its memory serves the next one
            self._places[key] = place.finished()
        self._places.move_to_end(key)
        return self._places[key]


def _row(arrays: Arrays, i: int) -> dict[str, np.ndarray]:
    """Arrays of one batch member."""
    return {name: array[min(i, len(array) - 1)] for name, array in arrays.items()}


def _put(part: Arrays, found: Mapping[str, np.ndarray], i: int) -> None:
    """Write the arrays of one batch member."""
    for name, whole in found.items():
        whole[i] = part[name]


def _key(points: Arrays) -> bytes:
    """A hash of the bits of arrays."""
    digest = blake2b(digest_size=32)
    for point in points.values():
        digest.update(np.ascontiguousarray(point).data)
    return digest.digest()
