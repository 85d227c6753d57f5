"""Drawings of wings: x points downstream, y up.

Grids of blocks have the patches ``wing_upper`` and ``wing_lower``. For unstructured meshes, the walls whose names begin
with ``wing`` are cut across the span, or all walls if there are none. The span is along z, from the plane of symmetry
to the tip. Nodes may be given as in the output ``grid``, shape (3 n_nodes,), or in rows, shape (n_nodes, 3), in metres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.background.mesh_model import MeshModel
from ...core.model.fitted_model import FittedModel
from ...names import GRID
from .figures import GRAY
from .histories import draw_history, draw_optimality, driver_styles
from .smooth_lines import curve_through, outline_through
from .wing_lines import section_of, sides_of, strips_of

if TYPE_CHECKING:  # OpenMDAO is not needed to draw
    import openmdao.api as om

    from ...core.om.drivers.recorded_run import RecordedRun

__all__ = [
    "draw_designs",
    "draw_ellipse",
    "draw_planform",
    "draw_sections",
    "draw_span_load",
    "draw_twist",
    "span_load_edges",
    "wing_section",
    "wing_sides",
]

PARTS = (0.05, 0.5, 0.9)
"""Sections that `draw_designs` shows, as fractions of the half span."""

BELOW = 0.25
"""Distance between sections drawn below each other, in chords."""


def wing_sides(model: FittedModel | MeshModel, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Upper and lower side of a wing from leading to trailing edge and root to tip, each (n_chord, n_span, 3) (m)."""
    return sides_of(model, np.reshape(nodes, (-1, 3)))


def wing_section(model: FittedModel | MeshModel, nodes: np.ndarray, part: float = 0.5) -> np.ndarray:
    """Points along the upper side of a section of a wing and back along the lower one, shape (n, 3) (m).

    ``part`` is a fraction of the half span; for a grid, the nodes of the nearest line are taken.
    """
    return section_of(model, np.reshape(nodes, (-1, 3)), part)


def draw_planform(axes: Any, model: FittedModel | MeshModel, nodes: np.ndarray, **style: Any) -> None:
    """Draw the outline of a wing from above.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    model : FittedModel or MeshModel
        The fitted grid, or the model of a mesh.
    nodes : ndarray
        Nodes (m).
    **style
        Keywords of ``plot``.
    """
    upper, _ = wing_sides(model, nodes)
    outline = np.concatenate([curve_through(edge) for edge in (upper[0], upper[:, -1], upper[-1][::-1])])
    axes.plot(outline[:, 2], outline[:, 0], **style)
    axes.set(xlabel="$z$ (m)", ylabel="$x$ (m)", aspect="equal")
    if not axes.yaxis_inverted():
        axes.invert_yaxis()


def draw_sections(
    axes: Any, model: FittedModel | MeshModel, nodes: np.ndarray, parts: Sequence[float] = PARTS, **style: Any
) -> None:
    """Draw sections at fractions of the half span below each other, in chords from their leading edges.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    model : FittedModel or MeshModel
        The fitted grid, or the model of a mesh.
    nodes : ndarray
        Nodes (m).
    parts : sequence of float
        Fractions of the half span.
    **style
        Keywords of ``plot``.
    """
    for number, part in enumerate(parts):
        section = outline_through(wing_section(model, nodes, part))
        leading = section[np.argmin(section[:, 0])]
        shape = (section - leading) / np.ptp(section[:, 0])
        axes.plot(shape[:, 0], shape[:, 1] - BELOW * number, **(style if number == 0 else style | {"label": None}))
    axes.set(xlabel="$x / c$", ylabel="$y / c$", aspect="equal")


def draw_twist(axes: Any, model: FittedModel | MeshModel, nodes: np.ndarray, **style: Any) -> None:
    """Draw the angles of the chord lines along the half span.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    model : FittedModel or MeshModel
        The fitted grid, or the model of a mesh.
    nodes : ndarray
        Nodes (m).
    **style
        Keywords of ``plot``.
    """
    upper, _ = wing_sides(model, nodes)
    chords = upper[-1] - upper[0]
    angles = np.degrees(np.arctan2(-chords[:, 1], chords[:, 0]))
    axes.plot(*curve_through(np.stack([upper[0, :, 2] / upper[0, -1, 2], angles], axis=1)).T, **style)
    axes.set(xlabel="$2 y / b$", ylabel="twist (deg)")


def span_load_edges(model: FittedModel | MeshModel, problem: om.Problem) -> np.ndarray:
    """Find where the strips of ``span_load`` of `EulerFlow` or `LatticeFlow` begin and end along the half span.

    Parameters
    ----------
    model : FittedModel or MeshModel
        The fitted grid, or the model of a mesh.
    problem : openmdao.api.Problem
        A problem with one of these flows that has been run.

    Returns
    -------
    ndarray, shape (n + 1,)
        Coordinates from the tip to the root (m).
    """
    names = {meta["prom_name"] for _, meta in problem.model.list_outputs(out_stream=None)}
    if "camber_surface" in names:
        return -problem.get_val("camber_surface")[-1, :, 1]
    strips = strips_of(model)
    return np.abs(strips.trailing @ problem.get_val(GRID).reshape(-1, 3) @ strips.axes[1])


def draw_span_load(axes: Any, edges: np.ndarray, load: np.ndarray, **style: Any) -> None:
    """Draw the load of strips along the half span, relative to its mean: dots at their centres, and a curve.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    edges : ndarray, shape (n + 1,)
        Ends of the strips along the half span (m), such as from `span_load_edges`.
    load : ndarray, shape (n,)
        Load per unit length.
    **style
        Keywords of ``plot``.
    """
    mean = load @ np.abs(np.diff(edges)) / np.ptp(edges)
    dots = np.stack([0.5 * (edges[1:] + edges[:-1]) / np.abs(edges).max(), load / mean], axis=1)
    (line,) = axes.plot(*curve_through(dots).T, **style)
    axes.plot(*dots.T, ".", color=line.get_color(), markersize=2.5 + line.get_linewidth())


def draw_ellipse(axes: Any, **style: Any) -> None:
    """Draw the elliptical load along the half span, relative to its mean, and name the axes of a span load.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    **style
        Keywords of ``plot``.
    """
    y = np.sin(np.linspace(0.0, 0.5 * np.pi, 101))
    style = {"color": "black", "linestyle": "--", "linewidth": 0.7, "label": "ellipse"} | style
    axes.plot(y, 4.0 / np.pi * np.sqrt(1.0 - y**2), **style)
    axes.set(xlabel="$2 y / b$", ylabel="load relative to its mean", xlim=(0.0, 1.0), ylim=(0.0, None))
    axes.legend()


def draw_designs(
    canvas: Any,
    model: FittedModel | MeshModel,
    start: om.Problem,
    runs: Mapping[str, RecordedRun],
    response: str,
    label: str,
    unit: float = 1.0,
) -> None:
    """Draw a wing at the start of an optimisation and at the optima: planform, sections, load, twist, and histories.

    Parameters
    ----------
    canvas : matplotlib.figure.Figure
        An empty figure, about 9.5 by 9 inches.
    model : FittedModel or MeshModel
        The fitted grid, or the model of a mesh.
    start : openmdao.api.Problem
        The problem at the start, with the outputs ``grid`` of `GridMovement` and ``span_load`` of a flow.
    runs : mapping of str to RecordedRun
        Optimisations by the names of their drivers.
    response : str
        Name of the response whose history is drawn.
    label : str
        Label of its axis.
    unit : float
        Divisor of the response.
    """
    (planform, sections), (load, twist), (history, optimality) = canvas.subplots(3, 2)
    styles = {"initial": {"color": GRAY}, **driver_styles(runs)}
    for name, problem in {"initial": start, **{name: run.problem for name, run in runs.items()}}.items():
        style, nodes = styles[name] | {"label": name}, problem.get_val(GRID)
        draw_planform(planform, model, nodes, **style)
        draw_sections(sections, model, nodes, PARTS, **style)
        draw_span_load(load, span_load_edges(model, problem), problem.get_val("span_load"), **style)
        draw_twist(twist, model, nodes, **style)
    draw_ellipse(load)
    draw_history(history, runs, response, label, lambda values: values / unit, log=False)
    draw_optimality(optimality, runs)
