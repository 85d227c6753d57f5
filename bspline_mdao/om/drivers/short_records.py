"""What recorders of a driver and of its problem take by default: all but long arrays."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

__all__ = ["ALL", "LONGEST", "ShortRecords", "sources_of"]

LONGEST = 10_000
"""Values up to which a variable is recorded where it is not asked for: grids and states of flows have more."""

ALL = "*"
"""Pattern that asks for everything, and for nothing in particular."""


class ShortRecords:
    """A driver that leaves long variables out of what ``"*"`` asks for, in its own records and in those of its problem.

    OpenMDAO asks the driver what recorders of either take. Variables that are named otherwise in
    ``recording_options["includes"]``, design variables and responses are taken, however long they are.
    """

    def _get_vars_to_record(self, obj=None) -> dict[str, Any]:
        """Names of what is recorded by ``"input"``, ``"output"`` and ``"residual"``; called by OpenMDAO."""
        found = super()._get_vars_to_record(obj)  # type: ignore[misc]
        recorded: Any = obj or self
        asked = [pattern for pattern in recorded.recording_options["includes"] if pattern != ALL]
        model, sources = self._problem().model, sources_of(self)  # type: ignore[attr-defined]
        about = model.get_io_metadata(metadata_keys=("size",), get_remote=model.comm.size > 1)

        def is_taken(name: str) -> bool:
            meta = about.get(name)
            size = None if meta is None else meta["size"]  # a word instead, where a variable has none
            if not isinstance(size, int | np.integer) or size <= LONGEST or name in sources:
                return True
            return any(fnmatchcase(each, pattern) for pattern in asked for each in (name, meta["prom_name"]))

        return {kind: [name for name in names if is_taken(name)] for kind, names in found.items()}


def sources_of(driver) -> frozenset[str]:
    """Absolute names of the outputs that are design variables or responses of a driver."""
    return frozenset(_sources(driver))


def _sources(driver) -> Iterable[str]:
    return (meta["source"] for found in (driver._designvars, driver._responses) for meta in found.values())
