"""The log of a steady solver: residuals, and whether they fell below the tolerance."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...errors import SolverError

__all__ = ["Convergence", "read_residuals"]


@dataclass(frozen=True, eq=False)
class Convergence(OneLine):
    """Convergence of a steady solver."""

    residuals: dict[str, np.ndarray]  # (n_iterations,), initial residual of every equation
    is_converged: bool  # whether all of them fell below the tolerance of the case

    @classmethod
    def of(cls, program: str, log: str) -> Convergence:
        """Read a log; `SolverError` if numbers are not finite, or nothing was solved."""
        residuals = read_residuals(log)
        if not residuals:
            raise SolverError(f"{program}: its log has no residuals; check it")
        bad = [name for name, values in residuals.items() if not np.isfinite(values).all()]
        if bad:
            iteration = int(np.argmin(np.isfinite(residuals[bad[0]]))) + 1
            raise SolverError(
                f"{program}: the residual of {bad[0]} is not finite from iteration {iteration} on, the flow diverged; "
                f"take a smaller step, or check the mesh and the relaxation"
            )
        return cls(residuals, "solution converged" in log)

    @property
    def n_iterations(self) -> int:
        """Iterations of SIMPLE."""
        return max(map(len, self.residuals.values()))

    @property
    def last(self) -> str:
        """Last residuals in words."""
        return ", ".join(f"{name} {values[-1]:.1e}" for name, values in self.residuals.items())


def read_residuals(log: str) -> dict[str, np.ndarray]:
    """Read the initial residuals of every equation, the first if one is solved twice in an iteration."""
    found: dict[str, list[float]] = {}
    for iteration in re.split(r"^Time = \S+$", log, flags=re.MULTILINE)[1:]:
        solved = re.findall(r"Solving for (\w+), Initial residual = ([^,]+),", iteration)
        for name, value in dict(reversed(solved)).items():
            found.setdefault(name, []).append(float(value))
    return {name: np.array(values) for name, values in found.items()}
