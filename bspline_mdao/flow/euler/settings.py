"""Settings of Newton's method and of its starts, each with the case behind its default.

``benchmarks/flow/sweep_settings.py`` measures the effect of a setting.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["NEWTON", "STARTS", "NewtonSettings", "StartSettings"]


@dataclass(frozen=True)
class NewtonSettings:
    """Settings of Newton steps with pseudo-time; residuals are relative to the uniform stream's."""

    first_cfl: float = 20.0
    """CFL number of the first step from the uniform stream."""

    first_long_cfl: float = 0.5
    """The same with long time steps: with 20 the first five steps are cut until it is lower."""

    smallest_cfl: float = 1e-2
    """CFL number at which cuts, and the run, end."""

    cfl_growth: float = 1.5
    """Growth of the CFL number beyond the inverse residual: time terms should fade faster than it."""

    largest_growth: float = 10.0
    """Largest growth of the CFL number in a step."""

    careful: int = 4
    """Steps after a shortened one in which the CFL number grows more slowly: late in a run each step that is too long
    costs a hundred products."""

    growth_after_cuts: float = 3.0
    """Largest growth in these steps."""

    largest_fall: float = 0.3
    """Largest relative decrease of a density or pressure in a step."""

    largest_rise: float = 2.0
    """Largest increase of the residual in a step."""

    smallest_step: float = 1e-3
    """Smallest acceptable fraction of a Newton step."""

    stalled: int = 36
    """Steps within which the residual must be halved, or the run ends: with long time steps shocks travel by about a
    cell each, at little cost. Successful flows took up to 29 such steps."""

    rounded: float = 1e-9
    """Residual below which steps without gain end the run: the rest is rounding of the fluxes."""

    rough: float = 0.1
    """Largest tolerance of the linear solves."""

    forcing: float = 1e-2
    """Smallest tolerance of the linear solves, if Newton steps leave less than a tenth."""

    rough_until: float = 1e-4
    """Residual up to which linear solves are rough."""

    factor_kept_from: float = 1e-3
    """Residual below which a step reuses the previous factor, which takes as long as ten products."""

    factor_kept_fall: float = 0.3
    """Reuse it if it left less than this fraction: without this condition 34 instead of 36 of 40 flows about the RAE
    2822 are found."""

    largest_solve: int = 300
    """Products after which a linear solve ends."""

    most_left: float = 0.8
    """Largest fraction of its residual that a cycle of a rough linear solve may leave; beyond, a smaller CFL number is
    cheaper. Later cuts lose Newton's convergence, as about the C-grid of CFL3D at M 0.663 and 5.45 degrees."""

    stagnation_steps: int = 8
    """Steps without a new lowest residual after which a run stagnates, see `.stagnation`."""

    stagnation_from: float = 1e-3
    """Upper bound of the residuals of all of these; with 3e-3 one flow fewer of 40 about the RAE 2822 was found."""

    stagnates_until: float = 0.1
    """Fraction of the lowest residual before stagnation, below which a run no longer stagnates."""

    long_rest_cfl: float = 5.0
    """CFL number to which a stagnating run returns with long time steps, and the first one with usual ones: with 50,
    residuals on all nodes of the pyHyp M6 at M 0.84 and 3 degrees oscillate."""

    most_growing: float = 0.4
    """Target of the growth of a step while a run stagnates. The residual then rises by 1/(1 - 0.4) per step; from 0.5
    on it would double, and partial steps would be taken."""

    most_products: int = 1200
    """Products with the Jacobian after which a run has failed: a third more than for the flow about a flat plate of
    20,736 cells at 4 degrees and M 0.3."""

    nearby_forcing: float = 2e-2
    """Tolerance of the linear solves with the Jacobian of a nearby flow, see `solve_nearby`."""

    nearby_products: int = 50
    """Products after which these have failed."""

    nearby_worth: float = 0.1
    """Largest fraction of the residual that a step with that Jacobian may leave; beyond, new Jacobians are cheaper."""


NEWTON = NewtonSettings()
"""The defaults."""


@dataclass(frozen=True)
class StartSettings:
    """Starts of Newton's method, see `cold_solutions`."""

    newton: NewtonSettings = NEWTON
    """Settings of the steps in all cases."""

    flat: float = 25.0
    """Cells whose long time steps are longer by more than this factor are flat. The factor that a tenth of
    the cells at walls exceed is 3 to 14 on H-H grids made here, and 37 to 992 on other grids with the spacing of
    boundary layers."""

    most_flat: float = 0.1
    """Fraction of flat cells at walls and planes of symmetry above which long time steps come first."""

    hard: int = 20
    """Number of usual Newton steps on a coarser member above which long ones come first."""

    member_tolerance: float = 1e-3
    """Residual of the flows on coarser members."""

    member_steps: int = 30
    """Largest number of Newton steps of the flows on coarser members."""

    smallest_member: int = 250
    """Number of cells below which a coarser member saves nothing."""


STARTS = StartSettings()
"""The defaults."""
