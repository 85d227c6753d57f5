"""Convergence log of a flow: a line for every Newton step, with the current lift and drag."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..euler.forces import FlowForces
from ..euler.newton_step import NewtonStep

__all__ = ["ResidualLog"]

HEAD = f"{'step':>6} {'residual':>10} {'CFL':>9} {'products':>9} {'length':>7} {'CL':>10} {'CD':>10}"
"""Names of the columns."""


class ResidualLog:
    """Prints a line for every Newton step of a run, below a header; with several processes the first one prints."""

    def __init__(
        self,
        name: str,  # name of the component
        forces: FlowForces,  # provides lift and drag from the states
        comm: Any,  # the processes, all of which log each step
        shows_alpha: bool = False,  # whether there is a column for the angle of attack, as in trimmed flow
    ):
        self.name, self.forces, self.comm, self.shows_alpha = name, forces, comm, shows_alpha
        self.n_steps = 0

    def log_step(
        self,
        step: NewtonStep,  # the step
        states: np.ndarray,  # (n_cells, 5), states after it
        nodes: np.ndarray,  # (n_nodes, 3), nodes of the grid (m)
        alpha: float,  # alpha, mach: angle of attack (rad) and Mach number
        mach: float,
    ) -> None:
        """Print the line of a step."""
        found = self.forces.evaluate(states, nodes, alpha, mach)
        if not self.n_steps:
            self._print(f"{self.name}\n{HEAD}{' alpha, deg' if self.shows_alpha else ''}")
        self.n_steps += 1
        self._print(
            f"{self.n_steps:>6} {step.residual:>10.2e} {step.cfl:>9.1e} {step.n_products:>9} {step.length:>7.2g} "
            f"{float(found['CL']):>10.6f} {float(found['CD']):>10.6f}"
            + (f" {np.degrees(alpha):>10.6f}" if self.shows_alpha else "")
        )

    def _print(self, text: str) -> None:
        if self.comm.rank == 0:
            print(text, flush=True)
