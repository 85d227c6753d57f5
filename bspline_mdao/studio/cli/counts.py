"""The option for numbers of control points, of all blocks or of single ones."""

from __future__ import annotations

import re
from collections.abc import Sequence

import click

Counts = tuple[int, int, int]


class BlockCounts(click.ParamType):
    """Control points per direction as ``IxJxK``, or for one block as ``BLOCK=IxJxK``."""

    name = "counts"

    def convert(
        self, value: str, param: click.Parameter | None, context: click.Context | None
    ) -> tuple[str | None, Counts]:
        """Convert the text of the option to the block, None for all, and three numbers."""
        match = re.fullmatch(r"(?:(.+)=)?(\d+)x(\d+)x(\d+)", value)
        if not match or not all(map(int, match.groups()[1:])):
            self.fail(f"'{value}' is not IxJxK or BLOCK=IxJxK, such as 9x9x7 or 2=13x9x7.", param, context)
        return match[1], (int(match[2]), int(match[3]), int(match[4]))


def _by_block(
    context: click.Context, param: click.Parameter, values: Sequence[tuple[str | None, Counts]]
) -> dict[str | None, Counts] | None:
    """Collect the requested numbers by block; None if there are none."""
    found: dict[str | None, Counts] = {}
    for block, counts in values:
        if block in found:
            what = f"block {block}" if block else "all blocks"
            raise click.BadParameter(f"{what} twice; give it once", context, param)
        found[block] = counts
    return found or None


n_control_option = click.option(
    "--n-control",
    multiple=True,
    type=BlockCounts(),
    callback=_by_block,
    metavar="[BLOCK=]IxJxK",
    help="Control points per direction in every block, or in one, by its number or name. Joined blocks follow, and the "
    "rest is chosen from the grid. May be repeated.",
)
