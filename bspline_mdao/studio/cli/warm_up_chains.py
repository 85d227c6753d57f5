"""The commands of usual work, in chains that run in parallel, see `warm_up`."""

from __future__ import annotations

import importlib.util

__all__ = ["CHAINS", "EULER", "MESH", "STUDY", "SURFACE", "chains"]

TINY = "@onera_m6:9x9x7"
"""Grid of chains that solve a flow. On larger grids the move factorises by other kernels: the chain of these has the
default size."""

STUDY, SURFACE, MESH = "euler.toml", "ball.xyz", "wing.su2"
"""Initial files of commands; `warm_up_inputs` writes them."""

EULER = """
[grid]
file = "m6.h5"

[variables.twist]
stations = 3
values = [2, 3]
lower = -6.0
upper = 6.0
ref = 3.0

[flow]
kind = "euler"
Mach_number = 0.5
trim = true
CL_target = 0.25

[objective]
of = "CD_induced"
ref = 0.005

[constraints.corner_ks]
lower = 0.05

[driver]
optimizer = "LD_SLSQP"
max_iterations = 2
"""
"""Study of the Euler equations, the README's example: `init` drafts it if there is no vortex lattice."""

FIT = ("fit", TINY, "-o", "m6.h5")

CHAINS: dict[str, tuple[tuple[str, ...], ...]] = {
    "flow": (FIT, ("optimize", STUDY, "-o", "flow")),
    "move": (
        ("fit", "@onera_m6", "-o", "m6.h5"),
        ("move", "m6.h5", "--deform", "twist=10deg", "-o", "moved.vtm"),
        ("inspect", "m6.h5"),
    ),
    "mesh": (
        ("fit", MESH, "-o", "mesh.h5"),
        ("move", "mesh.h5", "--deform", "twist=2deg", "-o", "moved.su2"),
        FIT,
        ("ride", "m6.h5", MESH, "--deform", "twist=2deg", "-o", "ridden.su2"),
    ),
    "designs": (
        FIT,
        ("sample", STUDY, "-n", "2", "-o", "designs"),
        ("improve", "m6.h5", "-o", "better.xyz", "--iterations", "2"),
        ("extrude", SURFACE, "-o", "ball.cgns", "--first-cell", "0.01", "--layers", "8", "--outer", "3"),
    ),
    "airfoil": (
        ("airfoil", "naca0012", "-o", "foil.h5", "--around", "32", "--away", "16"),
        ("init", "foil.h5", "-o", "foil.toml"),
        ("optimize", "foil.toml", "-o", "foil", "--max-iterations", "1"),
    ),
    "quality": (
        ("quality", TINY),
        ("fit", "@onera_m6:17x13x11", "-o", "m6.h5"),
        ("refine", "m6.h5", "-o", "fine.vtm"),
    ),
    "lattice": (
        FIT,
        ("init", "m6.h5", "-o", "wing.toml"),
        ("optimize", "wing.toml", "-o", "wing", "--max-iterations", "1"),
    ),
}
"""Commands that run one after another, in processes of their own. Long chains come first."""

EXTRAS = {"lattice": "openaerostruct"}
"""Optional modules that chains need."""


def chains() -> list[str]:
    """Names of the chains that can run here."""
    return [name for name in CHAINS if name not in EXTRAS or importlib.util.find_spec(EXTRAS[name])]
