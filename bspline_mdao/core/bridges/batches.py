"""What frameworks call: a chain at batches of arrays, with a memory of where it was last.

Frameworks ask for values first and for products with derivatives later, at the same arrays, and know nothing of our
states between. So the last places are kept, and found again by the bits of their arrays: a product at a place that is
kept costs no more than the component's own. Batches are leading axes, of one size or of length 1 where an array is the
same for all. Directions of one place go together: several right-hand sides for one factor.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
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
        """Names and shapes of what the function takes."""
        return self.chain.inputs

    @property
    def outputs(self) -> Shapes:
        """Names and shapes of what it gives."""
        return self.chain.outputs

    def taken(self, given: Any) -> list:
        """Arguments in the order of `inputs`, of what the user gives: an array, or arrays by names."""
        if not self.takes_names:
            return [given]
        if not isinstance(given, dict):
            raise InputError(f"the function takes values by names, {', '.join(self.inputs)}; give a dict of arrays")
        wrong = sorted(set(given) ^ set(self.inputs))
        if wrong:
            raise InputError(f"'{wrong[0]}' is missing or unknown; give arrays of {', '.join(self.inputs)}")
        return [given[name] for name in self.inputs]

    def returned(self, found: Sequence) -> Any:
        """What the user gets of arrays in the order of `outputs`."""
        return dict(zip(self.outputs, found)) if self.gives_names else found[0]

    def require_shapes(self, shapes: Sequence[tuple[int, ...]]) -> None:
        """Refuse arguments of other shapes than those of `inputs`."""
        for (name, shape), found in zip(self.inputs.items(), shapes):
            if tuple(found) != shape:
                raise InputError(f"'{name}' is of shape {tuple(found)}; give shape {shape}")

    def values(self, batch: tuple[int, ...], points: Sequence[np.ndarray]) -> Tuple:
        """Evaluate the chain at a batch of points."""
        return self._over(batch, list(self.inputs.values()), points, self.outputs, self._values_at)

    def products(
        self,
        batch: tuple[int, ...],  # lengths of the leading axes
        points: Sequence[np.ndarray],  # where the derivative is taken
        vectors: Sequence[np.ndarray],  # changes of all that the chain takes, or bars of all that it gives
        is_transposed: bool,
    ) -> Tuple:
        """Multiply vectors with the derivative, or with its transpose."""
        taken, given = (self.outputs, self.inputs) if is_transposed else (self.inputs, self.outputs)
        shapes = [*self.inputs.values(), *taken.values()]

        def products_at(arrays: list[np.ndarray]) -> list[np.ndarray]:
            n = len(self.inputs)
            place, along = self._place([array[0] for array in arrays[:n]]), arrays[n:]
            product = place.vjp if is_transposed else place.jvp
            rows = [product(dict(zip(taken, row))) for row in zip(*along)]
            return [np.stack([np.asarray(row[name]) for row in rows]) for name in given]

        return self._over(batch, shapes, [*points, *vectors], given, products_at, len(self.inputs))

    def _values_at(self, arrays: list[np.ndarray]) -> list[np.ndarray]:
        values = self._place([array[0] for array in arrays]).values
        return [np.asarray(values[name])[None] for name in self.outputs]

    def _over(
        self,
        batch: tuple[int, ...],
        shapes: Sequence[tuple[int, ...]],  # of one of every array
        arrays: Sequence[np.ndarray],
        given: Shapes,
        work: Callable[[list[np.ndarray]], list[np.ndarray]],
        n_points: int | None = None,  # how many arrays say where; all by default
    ) -> Tuple:
        """Work through a batch, place by place."""
        n = int(np.prod(batch, dtype=int))
        # every array once for all, or one for each of the batch
        rows = []
        for shape, array in zip(shapes, arrays):
            array = np.asarray(array, dtype=float)
            leading = array.shape[: array.ndim - len(shape)]
            if int(np.prod(leading, dtype=int)) > 1:
                array = np.broadcast_to(array, (*batch, *shape))
            rows.append(array.reshape(-1, *shape))
        found = [np.empty((n, *shape)) for shape in given.values()]
        with self._lock:
            if n_points is not None and all(len(array) == 1 for array in rows[:n_points]):
                along = [np.broadcast_to(array, (n, *array.shape[1:])) for array in rows[n_points:]]
                parts = work([*rows[:n_points], *along]) if n else found
                found = [np.asarray(part) for part in parts]
            else:
                for i in range(n):
                    part = work([array[min(i, len(array) - 1)][None] for array in rows])
                    for whole, of_one in zip(found, part):
                        whole[i] = of_one[0]
        return tuple(whole.reshape((*batch, *shape)) for whole, shape in zip(found, given.values()))

    def _place(self, points: list[np.ndarray]) -> ChainPlace:
        """Take the place that is kept for these points, or make it."""
        digest = blake2b(digest_size=32)
        for point in points:
            digest.update(np.ascontiguousarray(point).data)
        key = digest.digest()
        if key not in self._places:
            while len(self._places) >= self.memory:
                self._places.popitem(last=False)  # its memory serves the next one
            arrays: Arrays = {name: point.copy() for name, point in zip(self.inputs, points)}
            self._places[key] = self.chain.at(arrays)
        self._places.move_to_end(key)
        return self._places[key]
