"""Drawings of recorded optimisations, see `bspline_mdao.drivers.recorded`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .figures import BLUE, GREEN, ORANGE, PURPLE

if TYPE_CHECKING:  # OpenMDAO is not needed to draw
    from ...core.om.drivers.recorded_run import RecordedRun

__all__ = ["draw_history", "draw_optimality", "driver_styles"]


def driver_styles(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Give the lines of every driver a colour and a width: of several, a wide orange one below the others.

    Parameters
    ----------
    names : iterable of str
        Names of the drivers.

    Returns
    -------
    dict of dict
        Keywords of ``plot`` by name.
    """
    names = list(names)
    lines = (ORANGE, 4.0 if len(names) > 1 else 1.2), (BLUE, 1.2), (GREEN, 1.2), (PURPLE, 1.2)
    return {name: dict(zip(("color", "linewidth"), lines[n % len(lines)])) for n, name in enumerate(names)}


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
        Function of the values, shape (n,), that is drawn, such as their error.
    log : bool
        Whether the axis is logarithmic.
    """
    styles = driver_styles(runs)
    for name, run in runs.items():
        axes.plot(function(run.history[response].ravel()), label=name, **styles[name])
    axes.set(xlabel="evaluation", ylabel=label, yscale="log" if log else "linear")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend()


def draw_optimality(axes: Any, runs: Mapping[str, RecordedRun]) -> None:
    """Draw the optimality of every driver, relative to its first gradient, and the violations of constraints.

    The axis ends at the decade of the smallest optimality. A driver with only smaller violations has no line of them.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    runs : mapping of str to RecordedRun
        Optimisations by the names of their drivers.
    """
    styles = driver_styles(runs)
    relative = {name: run.convergence.residuals / run.convergence.residuals[0] for name, run in runs.items()}
    floor = 10.0 ** np.floor(np.log10(min([1.0, *(values[values > 0.0].min() for values in relative.values())])))
    label = "optimality relative to the first"
    for name, run in runs.items():
        found, style = run.convergence, styles[name]
        dots = {"markersize": 2.5 + style["linewidth"]}
        axes.semilogy(found.differentiated, relative[name], "o-", label=f"{name}: optimality", **style | dots)
        if (found.violations > floor).any():
            axes.semilogy(found.violations, ":", label=f"{name}: violation", **style)
            label = "optimality relative to the first, violation"
    axes.set_ylim(bottom=floor)
    axes.set(xlabel="evaluation", ylabel=label)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend(fontsize=8)
