"""What recorders of a driver and of its problem take by default: all but long arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from openmdao.core.driver import Driver

__all__ = ["ALL", "LONGEST", "ShortRecords", "short_records", "sources_of"]

LONGEST = 10_000
"""Values up to which a variable is recorded where it is not asked for: grids and states of flows have more."""

ALL = "*"
"""Pattern that asks for everything, and for nothing in particular."""


class ShortRecords:
    """A driver that leaves long variables out of what ``"*"`` asks for, in its own records and in those of its problem.

    OpenMDAO asks the driver what recorders of either take. Variables that are named otherwise in
    ``recording_options["includes"]``, design variables and responses are taken, however long they are.
    """

    def _get_vars_to_record(self, obj: Any = None) -> dict[str, Any]:
        """Names of what is recorded by ``"input"``, ``"output"`` and ``"residual"``; called by OpenMDAO."""
        found = super()._get_vars_to_record(obj)  # type: ignore[misc]
        return _without_long(self, found, obj or self)


def short_records(driver: Driver) -> Driver:
    """Let a driver of OpenMDAO leave grids and states out of ``"*"``, as the drivers of this package do.

    It holds for recorders of the driver and of its problem. Variables that are named otherwise in
    ``recording_options["includes"]``, design variables and responses are taken, however long they are. For recorders of
    a model or a solver take `CaseRecorder`.

    Parameters
    ----------
    driver : openmdao.api.Driver
        Such as ``om.ScipyOptimizeDriver()`` or ``om.pyOptSparseDriver()``; it is changed.

    Returns
    -------
    openmdao.api.Driver
        The same.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao.drivers import short_records
    >>> problem = om.Problem(driver=short_records(om.ScipyOptimizeDriver(optimizer="SLSQP")), reports=None)
    """
    if not isinstance(driver, ShortRecords) and not isinstance(driver._get_vars_to_record, _Shortened):
        driver._get_vars_to_record = _Shortened(driver, driver._get_vars_to_record)
    return driver


@dataclass(frozen=True)
class _Shortened:
    """What OpenMDAO asks a driver for, in the place of its own method."""

    driver: Any
    record: Callable[..., dict[str, Any]]

    def __call__(self, obj: Any = None) -> dict[str, Any]:
        return _without_long(self.driver, self.record(obj), obj or self.driver)


def _without_long(driver: Driver, found: dict[str, Any], recorded: Any) -> dict[str, Any]:
    """Leave long variables out that are neither named in the options of what is recorded nor a variable or response."""
    asked = [pattern for pattern in recorded.recording_options["includes"] if pattern != ALL]
    model, sources = driver._problem().model, sources_of(driver)
    about = model.get_io_metadata(metadata_keys=("size",), get_remote=model.comm.size > 1)

    def is_taken(name: str) -> bool:
        meta = about.get(name)
        size = None if meta is None else meta["size"]  # a word instead, where a variable has none
        if not isinstance(size, int | np.integer) or size <= LONGEST or name in sources:
            return True
        return any(fnmatchcase(each, pattern) for pattern in asked for each in (name, meta["prom_name"]))

    return {kind: [name for name in names if is_taken(name)] for kind, names in found.items()}


def sources_of(driver: Driver) -> frozenset[str]:
    """Absolute names of the outputs that are design variables or responses of a driver."""
    return frozenset(_sources(driver))


def _sources(driver: Driver) -> Iterable[str]:
    return (meta["source"] for found in (driver._designvars, driver._responses) for meta in found.values())
