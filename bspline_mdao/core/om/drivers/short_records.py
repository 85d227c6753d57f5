"""What recorders of a driver and of its problem record by default: everything except long arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from openmdao.core.driver import Driver

__all__ = ["ALL", "LONGEST", "ShortRecords", "short_records", "sources_of"]

LONGEST = 10_000
"""Largest size of a variable recorded without being named: grids and flow states have more values."""

ALL = "*"
"""Pattern that matches everything and names nothing."""


class ShortRecords:
    """A driver that leaves long variables out of what ``"*"`` matches, in its own records and its problem's."""

    # OpenMDAO asks the driver what the recorders of both record. Variables named explicitly in
    # ``recording_options["includes"]``, design variables and responses are recorded, however long they are.

    def _get_vars_to_record(self, obj: Any = None) -> dict[str, Any]:
        """Names of recorded variables by ``"input"``, ``"output"`` and ``"residual"``; called by OpenMDAO."""
        found = super()._get_vars_to_record(obj)  # type: ignore[misc]
        return _without_long(self, found, obj or self)


def short_records(driver: Driver) -> Driver:
    """Make an OpenMDAO driver leave grids and states out of ``"*"``, like the drivers of this package.

    This applies to recorders of the driver and of its problem. Variables named explicitly in
    ``recording_options["includes"]``, design variables and responses are recorded, however long they are. For recorders
    of a model or a solver use `CaseRecorder`.

    Parameters
    ----------
    driver : openmdao.api.Driver
        For example ``om.ScipyOptimizeDriver()`` or ``om.pyOptSparseDriver()``; it is changed in place.

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
    """Replacement for the driver's method that OpenMDAO calls."""

    driver: Any
    record: Callable[..., dict[str, Any]]

    def __call__(self, obj: Any = None) -> dict[str, Any]:
        return _without_long(self.driver, self.record(obj), obj or self.driver)


def _without_long(driver: Driver, found: dict[str, Any], recorded: Any) -> dict[str, Any]:
    """Leave out long variables that are neither named in the recording options nor a design variable or response."""
    asked = [pattern for pattern in recorded.recording_options["includes"] if pattern != ALL]
    model, sources = driver._problem().model, sources_of(driver)
    about = model.get_io_metadata(metadata_keys=("size",), get_remote=model.comm.size > 1)

    def is_taken(name: str) -> bool:
        meta = about.get(name)
        size = None if meta is None else meta["size"]  # a word if a variable has none
        if not isinstance(size, int | np.integer) or size <= LONGEST or name in sources:
            return True
        return any(fnmatchcase(each, pattern) for pattern in asked for each in (name, meta["prom_name"]))

    return {kind: [name for name in names if is_taken(name)] for kind, names in found.items()}


def sources_of(driver: Driver) -> frozenset[str]:
    """Absolute names of the outputs that are design variables or responses of a driver."""
    return frozenset(_sources(driver))


def _sources(driver: Driver) -> Iterable[str]:
    return (meta["source"] for found in (driver._designvars, driver._responses) for meta in found.values())
