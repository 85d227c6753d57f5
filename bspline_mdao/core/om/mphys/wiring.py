"""One-line errors for connections that MPhys silently makes wrong."""

from __future__ import annotations

import openmdao.api as om

from ....errors import InputError

__all__ = ["require_source_before"]


def require_source_before(
    component: om.ExplicitComponent,  # the component, of a problem that is set up
    name: str,  # its input
    advice: str,  # what to do about it
) -> None:
    """Refuse an input whose source runs later in a group without iteration: it would get the source's initial value."""
    source = component.get_source(f"{component.pathname}.{name}")
    ours, theirs = component.pathname.split("."), source.split(".")
    n_common = next(k for k, (a, b) in enumerate(zip(ours, theirs)) if a != b)
    group = component._problem_meta["model_ref"]()  # OpenMDAO has no public access to the groups around a component
    for part in ours[:n_common]:
        group = getattr(group, part)
    order = [system.name for system in group.system_iter(recurse=False)]
    iterates = not isinstance(group.nonlinear_solver, om.NonlinearRunOnce)
    if iterates or theirs[n_common] not in order or order.index(theirs[n_common]) < order.index(ours[n_common]):
        return
    raise InputError(f"{component.msginfo}: '{name}' comes from '{source}', which runs later; {advice}")
