"""What the commands show of the first cells at walls."""

from __future__ import annotations

from collections.abc import Sequence

from ..cells.first_cells import WallNode
from ..cells.report import KEPT, PatchHeights, WallSpacing, flat_plate_y_plus
from .output import print_lines, print_table

HEIGHTS = ("height_min", "height_median", "height_max")
"""What is told where there is no baseline to compare with."""


def height_numbers(heights: Sequence[PatchHeights], *, is_compared: bool) -> list[dict]:
    """Collect the heights at walls for JSON: with ratios where they are compared with a baseline."""
    return [
        {**vars(patch), "lowest": vars(patch.lowest), "highest": vars(patch.highest)}
        if is_compared
        else {name: getattr(patch, name) for name in ("patch", "n_nodes", "n_left_out", *HEIGHTS)}
        for patch in heights
    ]


def show_heights(heights: Sequence[PatchHeights]) -> None:
    """Print the heights at walls, if there are any."""
    if heights:
        columns = ["first cells at", "nodes", "height (m): min", "median", "max"]
        print_table(columns, [(h.patch, h.n_nodes, *_metres(h)) for h in heights])
    print_lines(
        [f"'{h.patch}': {h.n_left_out:,} nodes have no height and are left out" for h in heights if h.n_left_out]
    )


def show_height_ratios(heights: Sequence[PatchHeights]) -> None:
    """Print the heights at walls by those of a baseline, if there are any."""
    if heights:
        print_lines(["heights of the first cells at walls, by those of the baseline:"])
        columns = ["wall", "min", "1 %", "median", "99 %", "max", "worst at"]
        print_table(columns, [(h.patch, *_ratios(h), _place(h.worst[1])) for h in heights])


def _metres(wall: PatchHeights | WallSpacing) -> list[str]:
    return [f"{getattr(wall, name):.2e}" for name in HEIGHTS]


def _ratios(h: PatchHeights) -> list[str]:
    return [f"{x:.3f}" for x in (h.ratio_min, h.ratio_p01, h.ratio_median, h.ratio_p99, h.ratio_max)]


def _place(node: WallNode) -> str:
    return f"({node.i}, {node.j}, {node.k}) of {node.block}"


def height_warnings(heights: Sequence[PatchHeights]) -> list[str]:
    """Say which walls do not keep the heights of their first cells."""
    return [
        f"the first cells at '{h.patch}' are {h.ratio_p01:.3g} to {h.ratio_p99:.3g} times as high as before (1 % to "
        f"99 %), and so is y+; {h.n_off:,} of {h.n_nodes:,} nodes leave {KEPT[0]} to {KEPT[1]}, the worst with "
        f"{h.worst[0]:.3g} at {h.worst[1]}"
        for h in heights
        if not h.is_kept
    ]


def spacing_numbers(spacings: Sequence[WallSpacing], reynolds: float | None) -> list[dict]:
    """Collect the spacings at walls for JSON, with an estimate of y+ where a Reynolds number per metre is given."""
    return [{**vars(s), **({"y_plus": y_plus(s, reynolds)} if reynolds else {})} for s in spacings]


def show_spacings(spacings: Sequence[WallSpacing], reynolds: float | None) -> None:
    """Print the spacings at walls, if there are any."""
    if not spacings:
        return
    columns = ["first cells at", "height (m): min", "median", "max", "growth", "aspect"]
    rows = [(s.patch, *_metres(s), s.growth_median, s.aspect_median) for s in spacings]
    if reynolds:
        columns.append("y+")
        rows = [(*row, y_plus(s, reynolds)) for row, s in zip(rows, spacings)]
    print_table(columns, rows)
    if reynolds:
        print_lines([f"y+ at the median height, of a turbulent flat plate at {reynolds:.3g} per metre, is an estimate"])


def y_plus(spacing: WallSpacing, reynolds: float) -> float:
    """Estimate y+ at the median height of a wall, at a Reynolds number per metre.

    The plate is as long as the middle one of the sides of the wall's box, the chord of most wings: y+ goes with the
    fourteenth root of the length.
    """
    return flat_plate_y_plus(spacing.height_median, reynolds, spacing.extents[1])
