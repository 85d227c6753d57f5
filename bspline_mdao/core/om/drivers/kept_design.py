"""The best design of a run, which drivers keep whatever ends the run, and how they report it.

Theory: ``docs/theory/drivers.rst``, "How a run ends".
"""

from __future__ import annotations

from ..option_signature import OptionSignature
from .nlopt_problem import Point

__all__ = ["KeptDesign"]


class KeptDesign:
    """Common base of drivers that keep their best point in ``best``."""

    # best: the best point of the last run so far, in scaled variables, None before the first. It is kept whatever ends
    # the run.

    best: Point | None = None
    __signature__ = OptionSignature()

    @property
    def largest_violation(self) -> float:
        """Scaled violation up to which constraints count as satisfied."""
        raise NotImplementedError

    @property
    def is_feasible(self) -> bool:
        """Whether the best point of the last run satisfies all constraints."""
        return self.best is not None and self.best.violation <= self.largest_violation

    def best_in_words(self, best: Point) -> str:
        """Describe the best point, for a run that was interrupted."""
        limits = "is feasible" if self.is_feasible else f"violates constraints by up to {best.violation:.1e}"
        return (
            f"the best design so far has objective {best.objective:.10g} (scaled) and {limits}; it is kept in "
            f"driver.best, and the design variables are set to it: run_model() gives its outputs"
        )

    def add_best_to(self, error: BaseException, best: Point) -> None:
        """Name the best point in an exception that ends the run."""
        if hasattr(error, "add_note"):
            error.add_note(f"{type(self).__name__}: {self.best_in_words(best)}")
