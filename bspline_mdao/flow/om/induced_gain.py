"""What an optimisation has gained in induced drag, on the grid and on a finer one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ...base.display import OneLine
from ..euler.error_estimate import ErrorEstimate

__all__ = ["InducedGain", "induced_gains"]


@dataclass(frozen=True)
class InducedGain(OneLine):
    """By how much an induced drag has fallen, all relative to that of the baseline and divided by the lift squared."""

    # The square takes out that the lift of an angle of attack differs from grid to grid: errors are estimated at the
    # angle, and designs compared at the lift.

    name: str  # name of the induced drag
    gain: float  # on the grid
    finer: float  # as estimated for the finer member
    # what that may be wrong by: the larger ``remaining`` of both drags. Designs of one wing have much of their errors
    # in common.
    doubt: float

    @property
    def is_listed(self) -> bool:
        """Whether both grids have more of it than errors may be."""
        return min(self.gain, self.finer) > self.doubt

    @property
    def words(self) -> str:
        """What is said of it."""
        return (
            f"{self.name} by the square of the lift: {_less(self.gain)} on this grid, {_less(self.finer)} on the finer "
            f"one, which may be wrong by {100.0 * self.doubt:.1f} %"
        )

    @property
    def warning(self) -> str:
        """What is said where a finer grid may have no gain; nothing where it has one."""
        if self.is_listed:
            return ""
        return f"{self.words}: the errors of the grid may be all that was gained; run the study on a finer grid"


def induced_gains(before: Mapping[str, ErrorEstimate], after: Mapping[str, ErrorEstimate]) -> tuple[InducedGain, ...]:
    """Gains of all induced drags whose errors, and those of their lifts, are estimated at the baseline and at the end.

    Parameters
    ----------
    before, after : mapping of str to ErrorEstimate
        Estimates by name, ``CD_induced`` and ``CL`` with or without the name of a condition and a dot before them.
    """
    return tuple(_gains(before, after))


def _gains(before: Mapping[str, ErrorEstimate], after: Mapping[str, ErrorEstimate]) -> Iterator[InducedGain]:
    for name in after:
        inside, dot, last = name.rpartition(".")
        lift = f"{inside}{dot}CL"
        if last != "CD_induced" or not all({name, lift} <= found.keys() for found in (before, after)):
            continue
        pairs = [(found[name], found[lift]) for found in (before, after)]
        if not all(drag.value for drag, _ in pairs):  # a section leaves no wake
            continue
        was, now = (drag.value / lift.value**2 for drag, lift in pairs)
        finer_was, finer_now = (drag.finer / lift.finer**2 for drag, lift in pairs)
        doubt = max(drag.remaining / abs(drag.value) for drag, _ in pairs)
        yield InducedGain(name, 1.0 - now / was, 1.0 - finer_now / finer_was, doubt)


def _less(gain: float) -> str:
    return f"{100.0 * abs(gain):.1f} % {'less' if gain >= 0.0 else 'more'}"
