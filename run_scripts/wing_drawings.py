"""Drawings of wings whose grids have the patches ``wing_upper`` and ``wing_lower``."""

from __future__ import annotations

import numpy as np

from bspline_mdao import FittedModel


def wing_sides(model: FittedModel, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of the upper and the lower side, shape (n_chord, n_span, 3) each, of those of a grid, shape (3 n,)."""
    grid = model.header.grid(model.topology.shapes, nodes.reshape(-1, 3))
    windows = {patch.name: patch.windows[0] for patch in grid.patches}
    sides = [windows[name] for name in ("wing_upper", "wing_lower")]
    upper, lower = (grid.blocks[side.block].nodes[side.slices][:, 0] for side in sides)
    return upper, lower


def section_of(model: FittedModel, nodes: np.ndarray, part: float = 0.5) -> np.ndarray:
    """Nodes around the wing on the grid line that is nearest to a part of the span, shape (n, 3)."""
    upper, lower = wing_sides(model, nodes)
    nearest = np.argmin(np.abs(upper[0, :, 2] - part * upper[0, -1, 2]))
    return np.concatenate([upper[:, nearest], lower[::-1, nearest]])


def draw_planform(axes, model: FittedModel, nodes: np.ndarray, style: dict) -> None:
    """Draw the outline of a wing from above."""
    upper, _ = wing_sides(model, nodes)
    outline = np.concatenate([upper[0], upper[:, -1], upper[::-1][0][::-1]])
    axes.plot(outline[:, 2], outline[:, 0], **style)


def draw_sections(axes, model: FittedModel, nodes: np.ndarray, parts, style: dict) -> None:
    """Draw sections at parts of the span one below the other, in chords from their leading edges."""
    for number, part in enumerate(parts):
        section = section_of(model, nodes, part)
        leading = section[np.argmin(section[:, 0])]
        shape = (section - leading) / np.ptp(section[:, 0])
        axes.plot(shape[:, 0], shape[:, 1] - 0.25 * number, **(style if number == 0 else style | {"label": None}))


def draw_twist(axes, model: FittedModel, nodes: np.ndarray, style: dict) -> None:
    """Draw the angles of the chord lines along the half span."""
    upper, _ = wing_sides(model, nodes)
    chords = upper[-1] - upper[0]
    axes.plot(upper[0, :, 2] / upper[0, -1, 2], np.degrees(np.arctan2(-chords[:, 1], chords[:, 0])), **style)
    axes.set(xlabel="$2 y / b$", ylabel="twist (deg)")


def draw_load(axes, edges: np.ndarray, load: np.ndarray, style: dict) -> None:
    """Draw the load of the strips between edges along the half span by its mean, in the middles of the strips."""
    mean = load @ np.abs(np.diff(edges)) / np.ptp(edges)
    axes.plot(0.5 * (edges[1:] + edges[:-1]) / np.abs(edges).max(), load / mean, **style)


def draw_ellipse(axes) -> None:
    """Draw the elliptical load by its mean."""
    y = np.sin(np.linspace(0.0, 0.5 * np.pi, 101))
    axes.plot(y, 4.0 / np.pi * np.sqrt(1.0 - y**2), "k--", linewidth=0.7, label="ellipse")
    axes.set(xlabel="$2 y / b$", ylabel="load by its mean", xlim=(0.0, 1.0), ylim=(0.0, None))
    axes.legend()
