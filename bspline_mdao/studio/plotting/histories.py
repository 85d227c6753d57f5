"""Drawings of recorded optimisations, see `bspline_mdao.drivers.recorded`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .figures import BLUE, GREEN, ORANGE, PURPLE

if TYPE_CHECKING:  # the framework is not needed to draw
    from ...core.om.drivers.recorded_run import RecordedRun

__all__ = ["draw_history", "draw_optimality", "driver_colors"]

LEAST = 1e-12
"""Violations below it are drawn as if they were this, since a logarithmic axis has no zero."""


def driver_colors(names: Iterable[str]) -> dict[str, str]:
    """Give every driver a colour: the first is orange, the second blue.

    Parameters
    ----------
    names : iterable of str
        Names of the drivers.

    Returns
    -------
    dict of str
        Colours by name.
    """
    return {name: (ORANGE, BLUE, GREEN, PURPLE)[n % 4] for n, name in enumerate(names)}


def draw_history(
    axes: Any,
    runs: Mapping[str, RecordedRun],
    response: str,
    label: str,
    function: Callable[[np.ndarray], np.ndarray] = np.abs,
    log: bool = True,
) -> None:
    """Draw a response over the evaluations of every driver.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    runs : mapping of str to RecordedRun
        Optimisations by the names of their drivers.
    response : str
        Name of an objective or constraint of one value.
    label : str
        Label of the axis.
    function : callable
        What is drawn of the values, shape (n,), such as their error.
    log : bool
        Whether the axis is logarithmic.
    """
    colors = driver_colors(runs)
    for name, run in runs.items():
        axes.plot(function(run.history[response].ravel()), color=colors[name], label=name, linewidth=1.0)
    axes.set(xlabel="evaluation", ylabel=label, yscale="log" if log else "linear")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend()


def draw_optimality(axes: Any, runs: Mapping[str, RecordedRun]) -> None:
    """Draw the optimality of every driver, relative to that of its first gradient, and the violations of constraints.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    runs : mapping of str to RecordedRun
        Optimisations by the names of their drivers.
    """
    colors = driver_colors(runs)
    for name, run in runs.items():
        found, style = run.convergence, {"color": colors[name], "linewidth": 1.0, "markersize": 3}
        relative = found.residuals / found.residuals[0]
        axes.semilogy(found.differentiated, relative, "o-", label=f"{name}: optimality", **style)
        if found.violations.any():
            axes.semilogy(np.maximum(found.violations, LEAST), ":", label="violation", **style)
    axes.set(xlabel="evaluation", ylabel="optimality relative to the first, violation")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend(fontsize=8)
