"""Lines of a flow that converges: one for every Newton step, with the lift and drag that it has by then."""

from __future__ import annotations

import numpy as np

from ..euler.forces import FlowForces
from ..euler.newton_step import NewtonStep

__all__ = ["ResidualLog"]

HEAD = f"{'step':>6} {'residual':>10} {'CFL':>9} {'products':>9} {'length':>7} {'CL':>10} {'CD':>10}"
"""Names of the columns."""


class ResidualLog:
    """Print a line for every Newton step of a run, below a head line; of several processes the first one prints.

    Parameters
    ----------
    name : str
        Name of the component.
    forces : FlowForces
        Gives lift and drag of the states.
    comm : communicator
        The processes, all of which tell each step.
    shows_alpha : bool
        Whether there is a column for the angle of attack, as where it is solved for.
    """

    def __init__(self, name: str, forces: FlowForces, comm, shows_alpha: bool = False):
        self.name, self.forces, self.comm, self.shows_alpha = name, forces, comm, shows_alpha
        self.n_steps = 0

    def tell(self, step: NewtonStep, states: np.ndarray, nodes: np.ndarray, alpha: float, mach: float) -> None:
        """Print the line of a step.

        Parameters
        ----------
        step : NewtonStep
            The step.
        states : ndarray, shape (n_cells, 5)
            States after it.
        nodes : ndarray, shape (n_nodes, 3)
            Nodes of the grid (m).
        alpha, mach : float
            Angle of attack (rad) and Mach number.
        """
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
