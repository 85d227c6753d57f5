"""Reduction of induced drag by an optimisation, on the grid and on a finer one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ...base.display import OneLine
from ..euler.error_estimate import ErrorEstimate

__all__ = ["InducedGain", "induced_gains"]


@dataclass(frozen=True)
class InducedGain(OneLine):
    """Reduction of an induced drag, relative to the baseline and divided by the lift squared."""

    # The square compensates for the lift of an angle of attack, which differs from grid to grid: errors are estimated
    # at the angle, and designs compared at the lift.

    name: str  # name of the induced drag
    gain: float  # on the grid
    finer: float  # estimate for the finer member
    # its error bound: the larger ``remaining`` of both drags. Designs of one wing have much of their errors in common.
    doubt: float

    @property
    def is_listed(self) -> bool:
        """Whether both grids show a reduction larger than the errors."""
        return min(self.gain, self.finer) > self.doubt

    @property
    def words(self) -> str:
        """Description in words."""
        return (
            f"{self.name} by the square of the lift: {_less(self.gain)} on this grid, {_less(self.finer)} on the finer "
            f"one, which may be wrong by {100.0 * self.doubt:.1f} %"
        )

    @property
    def warning(self) -> str:
        """Warning if a finer grid may show no reduction; empty if it shows one."""
        if self.is_listed:
            return ""
        return f"{self.words}: the errors of the grid may be all that was gained; run the study on a finer grid"


def induced_gains(before: Mapping[str, ErrorEstimate], after: Mapping[str, ErrorEstimate]) -> tuple[InducedGain, ...]:
    """Reductions of all induced drags whose errors, and their lifts' errors, are estimated at the baseline and the end.

    Estimates are given by name, ``CD_induced`` and ``CL`` with or without the name of a condition and a dot before
    them.
    """
    return tuple(_gains(before, after))


def _gains(before: Mapping[str, ErrorEstimate], after: Mapping[str, ErrorEstimate]) -> Iterator[InducedGain]:
    for name in after:
        inside, dot, last = name.rpartition(".")
        lift = f"{inside}{dot}CL"
        if last != "CD_induced" or not all({name, lift} <= found.keys() for found in (before, after)):
            continue
        pairs = [(found[name], found[lift]) for found in (before, after)]
        if not all(drag.value for drag, _ in pairs):  # a section has no wake
            continue
        was, now = (drag.value / lift.value**2 for drag, lift in pairs)
        finer_was, finer_now = (drag.finer / lift.finer**2 for drag, lift in pairs)
        doubt = max(drag.remaining / abs(drag.value) for drag, _ in pairs)
        yield InducedGain(name, 1.0 - now / was, 1.0 - finer_now / finer_was, doubt)


def _less(gain: float) -> str:
    return f"{100.0 * abs(gain):.1f} % {'less' if gain >= 0.0 else 'more'}"
