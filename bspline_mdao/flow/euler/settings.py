"""Settings of Newton's method and of its starts, each with the case behind its default.

What a setting brings is measured by ``benchmarks/flow/sweep_settings.py``.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["NEWTON", "STARTS", "NewtonSettings", "StartSettings"]


@dataclass(frozen=True)
class NewtonSettings:
    """How Newton steps with pseudo-time are made; residuals are relative to that of the uniform stream."""

    first_cfl: float = 20.0
    """CFL number of the first step from the uniform stream."""

    first_long_cfl: float = 0.5
    """That with long time steps: with 20 the first five steps are cut until it is less."""

    smallest_cfl: float = 1e-2
    """Where cuts of the CFL number end, and the run with them."""

    cfl_growth: float = 1.5
    """Growth of the CFL number in addition to that of the inverse residual: time terms are to fade faster than it."""

    largest_growth: float = 10.0
    """Most growth of the CFL number in a step."""

    careful: int = 4
    """Steps after a shortened one in which the CFL number grows by less: late in a run each step that is too long costs
    a hundred products."""

    growth_after_cuts: float = 3.0
    """Most growth in these."""

    largest_fall: float = 0.3
    """Largest relative fall of a density or pressure in a step."""

    largest_rise: float = 2.0
    """Largest rise of the residual in a step."""

    smallest_step: float = 1e-3
    """Smallest part of a Newton step that is worth its residual."""

    stalled: int = 36
    """Steps within which the residual has to be halved, or the run ends: with long time steps shocks travel by about a
    cell each, at little cost. Flows that were found took up to 29 such steps."""

    rounded: float = 1e-9
    """Residual below which steps that gain nothing end the run: what is left is rounding of the fluxes."""

    rough: float = 0.1
    """Largest tolerance of the linear solves."""

    forcing: float = 1e-2
    """Smallest tolerance of the linear solves, where Newton's steps leave less than a tenth."""

    rough_until: float = 1e-4
    """Residual up to which linear solves are rough."""

    factor_kept_from: float = 1e-3
    """Residual from which on a step has the factor of the one before, which takes as long as ten products."""

    factor_kept_fall: float = 0.3
    """As long as that left less than this part: where any will do, 34 in place of 36 of 40 flows about the RAE 2822 are
    found."""

    largest_solve: int = 300
    """Products after which a linear solve ends."""

    most_left: float = 0.8
    """Part of its residual that a cycle of a rough linear solve may leave; beyond, a smaller CFL number is cheaper.
    Cuts later on give Newton's convergence away, as about the C-grid of CFL3D at M 0.663 and 5.45 degrees."""

    stagnation_steps: int = 8
    """Steps without a new lowest residual after which a run stagnates, see `.stagnation`."""

    stagnation_from: float = 1e-3
    """Residual that all of these are below; from 3e-3 on one flow fewer of 40 about the RAE 2822 was found."""

    stagnates_until: float = 0.1
    """Part of the lowest residual before it stagnated below which a run stagnates no longer."""

    long_rest_cfl: float = 5.0
    """CFL number that a run which stagnates goes back to with long time steps, the first one with usual ones: about all
    nodes of the pyHyp M6 at M 0.84 and 3 degrees residuals go up and down with 50."""

    most_growing: float = 0.4
    """What the growth of what a step is made of is led to while a run stagnates. The residual then rises by 1/(1 - 0.4)
    a step; from 0.5 on it would double, and parts of steps would be taken."""

    most_products: int = 1200
    """Products with the Jacobian after which a run has failed: a third more than the flow about a flat plate of 20,736
    cells at 4 degrees and M 0.3 takes."""

    nearby_forcing: float = 2e-2
    """Tolerance of the linear solves with the Jacobian of a flow nearby, see `solve_nearby`."""

    nearby_products: int = 50
    """Products after which these have failed."""

    nearby_worth: float = 0.1
    """Part of the residual that a step with that Jacobian may leave; beyond, new Jacobians are cheaper."""


NEWTON = NewtonSettings()
"""The defaults."""


@dataclass(frozen=True)
class StartSettings:
    """Where Newton's steps start from, see `cold_solutions`."""

    newton: NewtonSettings = NEWTON
    """Of the steps of all ways."""

    flat: float = 25.0
    """Cells whose time steps are longer by more than this when long are flat: 3 to 14 times at the tenth part on H-H
    grids made here, 37 to 992 on grids of others with the spacing of boundary layers."""

    most_flat: float = 0.1
    """Part of the cells at walls and planes of symmetry above which long time steps come first."""

    hard: int = 20
    """Usual Newton steps of a flow on a coarser member beyond which long ones come first."""

    member_tolerance: float = 1e-3
    """Residual of the flows on coarser members."""

    member_steps: int = 30
    """Newton steps of the flows on coarser members at most."""

    smallest_member: int = 250
    """Cells below which a coarser member saves nothing."""


STARTS = StartSettings()
"""The defaults."""
