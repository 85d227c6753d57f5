"""The command ``wing``: an H-H grid about a wing of a planform and sections, fitted or not."""

from __future__ import annotations

from pathlib import Path

from ...base.text import counted
from .made_grid import MadeGrid, write_made_grid
from .output import check_outputs, counts_text
from .planform import read_wing


def make_wing(
    planform: Path,  # file of planform, sections and spacings
    output: Path,  # output, json: model or grid, and numbers to write
    json: Path | None,
    allow_invalid: bool,  # write a grid with inverted cells anyway
) -> None:
    """Make the grid, fit it if asked, write it and describe it."""
    check_outputs([output, json], [planform])
    write_made_grid(lambda: _made(planform), output, json, allow_invalid)


def _made(file: Path) -> MadeGrid:
    """The grid, and a description of its wing."""
    wing, grid, reynolds = read_wing(file)
    planform, between = wing.planform, wing.sections_between
    thickness = wing.section.thickness, wing.outer_section.thickness
    shape = {
        "semi_span": planform.semi_span,
        "root_chord": planform.root_chord,
        "tip_chord": planform.tip_chord,
        "aspect_ratio": planform.aspect_ratio,
        "trailing_edge_sweep": planform.trailing_edge_sweep,
        "kinks": planform.kinks,
        "thickness": thickness,
        "thickness_between": [(place, section.thickness) for place, section in between],
    }
    lines = [
        f"half wing: semi-span {planform.semi_span:g} m, chords {planform.root_chord:g} and {planform.tip_chord:g} m, "
        f"aspect ratio {planform.aspect_ratio:.3g}, the trailing edge swept by {planform.trailing_edge_sweep:.3g} deg",
        f"sections: {100.0 * thickness[0]:.4g} % thick at the root, {100.0 * thickness[1]:.4g} % at the tip"
        + "".join(f", {100.0 * section.thickness:.4g} % at {place:g} m" for place, section in between),
    ]
    if planform.kinks:
        places = ", ".join(f"{place:g}" for place in planform.kinks)
        lines.append(f"{counted(len(planform.kinks), 'kink')} at {places} m, where nodes and edges of blocks are")
    shapes = sorted(set(grid.shapes), key=grid.shapes.index)
    title = f"{file}: {len(grid.blocks)} blocks of {' and '.join(map(counts_text, shapes))} nodes"
    cure = "give more nodes, or wider first cells"
    return MadeGrid(grid, title, lines, {"planform": str(file), **shape}, reynolds, cure)
