"""The page of ``live``: CPU milliseconds of one update, part by part, as a slider moves.

A wing of about 200,000 nodes by default, with the control points that a fit chooses and with fewer. The
denominator of the ratio is the 50 ms in which an update feels like nothing. What the drawing costs on this side is the
list of VTK's objects that have changed, as trame takes them. While the slider moves, cells are made that are seen, and
those that are worst on the baseline; the rest when it rests.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from bspline_mdao import fit_grid
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.studio.live.scene import Scene, View
from bspline_mdao.studio.live.shape import LiveModel

ASKED = 0.050
"""CPU seconds of one update."""

SHAPE = (33, 23, 22)
"""Nodes of the wing: 200,000 of the grid."""

COUNTS = {"few": (5, 5, 5), "by itself": None}
"""Control points of each block."""


def main(shape=SHAPE, n_updates: int = 12, counts=tuple(COUNTS)) -> dict:
    """Move the twist of a wing step by step.

    Parameters
    ----------
    shape : sequence of int
        Size of the wing, as `onera_m6_grid` takes it.
    n_updates : int
        Updates that are measured; their median counts.
    counts : sequence of str
        Which of `COUNTS`.

    Returns
    -------
    dict
        For each of the counts, numbers of nodes and control points, and CPU seconds of each part.
    """
    return {name: _measured(fit_grid(onera_m6_grid(shape), n_control=COUNTS[name]), n_updates) for name in counts}


def _measured(model, n_updates: int) -> dict:
    live = LiveModel(model)
    scene, number = Scene(live), [slider.name for slider in live.sliders].index("twist")
    parts: dict[str, list[float]] = {}
    for n in range(n_updates + 2):
        shape = live.at(live.neutral.with_value(number, 0.5 * (n + 1)), part=scene.part(View()))
        began = time.process_time()
        scene.show(shape, View())
        drawn, whole = time.process_time() - began, live.completed(shape)
        if n >= 2:  # the first ones make what the others share
            rest = sum(whole.seconds.values())
            for part, seconds in {**shape.seconds, "drawing": drawn, "rest": rest}.items():
                parts.setdefault(part, []).append(seconds)
    medians = {part: float(np.median(seconds)) for part, seconds in parts.items() if part != "lift"}
    rest = medians.pop("rest")
    update = sum(medians.values())
    return {
        "n_nodes": model.n_nodes,
        "n_control_points": len(model.control_points),
        "parts": medians,
        "update": update,
        "by_asked": update / ASKED,
        "rest": rest,
    }


def show(results: dict) -> None:
    """Print the figures as a table."""
    for name, found in results.items():
        print(f"{found['n_nodes']:,} nodes, {found['n_control_points']:,} control points ({name})")
        for part, seconds in found["parts"].items():
            print(f"  {part:10s}{1e3 * seconds:8.1f} ms")
        print(f"  {'update':10s}{1e3 * found['update']:8.1f} ms, {found['by_asked']:.2f} of what is asked")
        print(f"  {'rest':10s}{1e3 * found['rest']:8.1f} ms: all of the grid, and lift, when the hand rests")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument("--shape", type=int, nargs=3, default=SHAPE, metavar=("I", "J", "K"), help="size of the wing")
    arguments = parser.parse_args()
    measured = main(arguments.shape)
    show(measured)
    if arguments.json:
        arguments.json.write_text(json.dumps(measured, indent=2))
