"""How ``check_partials`` checks a component: products along one random direction in each input."""

from __future__ import annotations

import openmdao.api as om

__all__ = ["check_along_directions"]


def check_along_directions(
    component: om.Component,  # the component
    step: float,  # step of the differences, in the units of the inputs
    wrt: str = "*",  # inputs, by name or pattern
    # use complex steps instead of differences if the problem was set up with ``setup(force_alloc_complex=True)``: for
    # components whose kernels are exact under complex step
    is_complex: bool = False,
) -> None:
    """Make ``check_partials`` compare products along one random direction in each input with central differences."""
    # OpenMDAO's default runs the component once for every input value, and stores the whole Jacobian. Call this in
    # ``setup``; what a user sets on the component after ``Problem.setup`` overrides it.
    #
    # A component whose processes depend on each other is also a `bspline_mdao.core.om.component.CheckedOnProcesses`.
    if is_complex and component._force_alloc_complex:  # OpenMDAO has no public name for it
        component.set_check_partial_options(wrt, method="cs", directional=True)
    else:
        component.set_check_partial_options(wrt, method="fd", form="central", step=step, directional=True)
