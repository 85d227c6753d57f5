"""The final picture of a section's optimisation: pressures and sections before and after."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from ...core.mesh.surface import SurfaceGrid
from ...core.model.fitted_model import FittedModel
from ...core.om.drivers.case_history import CaseHistory, read_history
from ...errors import InputError
from ...flow.euler.gas import critical_pressure
from ..plotting.figures import BLUE, GRAY, figure
from ..plotting.pressures import draw_pressures
from ..plotting.smooth_lines import outlines_at
from .block_subject import BlockSubject
from .contents import RECORD, axes_of, shapes_of

__all__ = ["plot_section"]

WIDTH, HEIGHT = 5.2, 6.2
"""Inches of a picture for each flight condition, and in total; the smallest width is 6.5."""

NEAR = 1e-9
"""Distance of the cut from the plane of the first nodes, in depths of the grid: along edges, not between nodes."""


def plot_section(
    path: str | os.PathLike, case_file: str | os.PathLike | CaseHistory, model: FittedModel, most: int = 4
) -> Path:
    """Draw pressures around a section, and the section, before and after an optimisation.

    There is a plot of the pressures for each flight condition, with the critical pressure if the flow can be
    supersonic, and lift and drag if they are recorded. Sections are the curves through all nodes of the wall, at equal
    scales.

    Parameters
    ----------
    path : path-like
        The file, ``something.png``.
    case_file : path-like or CaseHistory
        Cases of a driver, with the outputs ``control_points`` and ``Cp``.
    model : FittedModel
        The model that was optimised: the grid about a section, see `SurfaceGrid.is_section`.
    most : int
        Largest number of flight conditions to draw.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the grid is not about a section, nothing of its shape is recorded, or matplotlib is not installed.
    """
    path = Path(path)
    if path.suffix != ".png":
        raise InputError(f"{path}: the picture of a section is a PNG file; give a name that ends in .png")
    surface = SurfaceGrid.of(model)
    if not surface.is_section:
        raise InputError(f"{model.source}: is no grid about a section, one layer of cells deep; draw wings by `plot`")
    history = case_file if isinstance(case_file, CaseHistory) else read_history(case_file)
    subject = BlockSubject(model)
    shapes, _ = shapes_of(subject, history)
    flows = list(shapes[0].pressures)[:most]
    if not flows:
        raise InputError(f"{path}: no pressures Cp of this section are in the case file; record them: {RECORD}")
    axes = axes_of(subject, surface.points, history.options)
    order = [axes.downstream, axes.up, axes.span]
    numbers = dict(zip((shape.label for shape in shapes), (0, history.best)))
    corners = subject.pressure_faces
    with figure(path.parent, path.stem, (max(6.5, WIDTH * len(flows)), HEIGHT)) as canvas:
        rows = [flows, ["section"] * len(flows)]
        panels = canvas.subplot_mosaic(rows, height_ratios=[2.6, 1.0])
        for shape, color in zip(shapes, (GRAY, BLUE)):
            style = {"color": color, "linewidth": 1.0 if color == GRAY else 1.5}
            lines = _outlines(shape.nodes[surface.rows][:, order], surface.quads)
            for line in lines:
                panels["section"].plot(*line.T, **style)
            for name in flows:
                quads = shape.nodes[corners][..., order]
                # with several elements, faces do not follow a line
                marks = {"marker": ".", "markersize": 2.5, "linestyle": "-" if len(lines) == 1 else "none"}
                label = shape.label.lower() + _loads(history, name, numbers[shape.label])
                place = float(quads[..., 2].mean())
                draw_pressures(panels[name], quads, shape.pressures[name], place, label=label, **style, **marks)
        for name in flows:
            _finish(panels[name], history, name)
        panels["section"].locator_params(axis="y", nbins=4)
        letters = ["xyz"[axis] for axis in order]
        panels["section"].set(
            aspect="equal", xlabel=f"${letters[0]}$ ({axes.unit})", ylabel=f"${letters[1]}$ ({axes.unit})"
        )
    return path


def _finish(panel: Any, history: CaseHistory, name: str) -> None:
    """Title and legend of the pressures of a flow, and the critical pressure if it is in their range."""
    mach = _number(history, name, "Mach_number", 0)
    if mach is not None:
        condition = name.rpartition(".")[0]
        panel.set_title(f"{condition + ', ' if condition else ''}$M = {mach:g}$", fontsize=11)
        critical = critical_pressure(mach)
        if panel.get_ylim()[1] < critical < 0.0:
            panel.axhline(critical, color="black", linewidth=0.6, linestyle=":")
            panel.annotate("$C_p^*$", (1.0, critical), ha="right", va="bottom", fontsize=10)
    panel.legend(fontsize=9, loc="lower center")


def _loads(history: CaseHistory, name: str, case: int) -> str:
    """Lift and drag of a section in the flow of these pressures, as far as they are recorded."""
    lift, drag = (_number(history, name, each, case) for each in ("CL", "CD"))
    found = [f"$c_l = {lift:.3f}$"] if lift is not None else []
    found += [f"$c_d$ {1e4 * drag:.1f} counts"] if drag is not None else []
    return "".join(f", {each}" for each in found)


def _number(history: CaseHistory, name: str, other: str, case: int) -> float | None:
    """An output of the flow that has the pressures of this name; None if it is not recorded."""
    other = name.removesuffix("Cp") + other
    responses = [quantity.values[case] for quantity in history.quantities if quantity.name == other]
    recorded = history.outputs.get(other, {})
    found = responses or ([recorded[case]] if case in recorded else [])
    return float(np.ravel(found[0])[0]) if found else None


def _outlines(
    points: np.ndarray,  # (n, 3), nodes of the walls: downstream, up, along the span (m)
    quads: np.ndarray,  # (n_faces, 4) of int, their faces
) -> list[np.ndarray]:  # each (m, 2), of every element (m)
    """The curves through the nodes in the first plane of a section, smooth but for sharp edges."""
    first, depth = points[:, 2].min(), np.ptp(points[:, 2])
    return outlines_at(first + NEAR * depth, points, quads, (0, 1, 2))
