"""OpenFOAM's own coefficients, with the references of the flow, to compare with this package's."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .flow_case import FlowCase, FreeStream

__all__ = ["functions_text", "pitch_axis", "printed_coefficients"]

NAME = "bspline_mdao_forces"
"""Name of the function object."""

COLUMNS = {"CL": "Cl", "CD": "Cd", "CM_pitch": "CmPitch"}
"""OpenFOAM's names of lift, drag, and the moment about `pitch_axis`."""


def functions_text(
    case: FlowCase,
    stream: FreeStream,
    walls: Sequence[str],  # names of the patches
    directions: np.ndarray,  # (2, 3), drag and lift
    axes: np.ndarray,  # (3, 3), rows are the directions downstream, along the span, and up
    references: tuple[float, float, Sequence[float]],  # area (m^2), chord (m) and reference point of moments (m)
) -> str:
    """Entries of ``system/controlDict`` for coefficients, and for viscous flows for friction and y+."""
    area, chord, point = references
    drag, lift = map(_vector, directions)
    is_kinematic = case.speed_name == "speed"
    entries = [
        f"type forceCoeffs; libs (forces); patches ({' '.join(walls)}); rho {'rhoInf' if is_kinematic else 'rho'};",
        f"rhoInf {stream.density!r}; pRef {stream.pressure!r}; magUInf {stream.speed!r};",
        f"lRef {float(chord)!r}; Aref {float(area)!r};",
        f"CofR {_vector(point)}; dragDir {drag}; liftDir {lift}; pitchAxis {_vector(pitch_axis(axes))};",
        "log false; writeControl writeTime;",
    ]
    texts = [f"{NAME}\n{{\n    {chr(10).join(entries)}\n}}"]
    if case.is_viscous:
        texts += [
            f"{name} {{ type {name}; libs (fieldFunctionObjects); writeControl writeTime; log false; }}"
            for name in ("wallShearStress", "yPlus")
        ]
    return "\nfunctions\n{\n" + "\n".join(texts) + "\n}\n"


def pitch_axis(axes: np.ndarray) -> np.ndarray:
    """Axis about which noses turn up: OpenFOAM derives it from lift and drag, whatever is given."""
    return np.cross(axes[2], axes[0])


def printed_coefficients(case: Path) -> dict[str, float] | None:
    """Coefficients that OpenFOAM wrote last; None if it wrote none."""
    for file in sorted((case / "postProcessing" / NAME).glob("*/coefficient*.dat")):
        lines = file.read_text().splitlines()
        heads = [line.lstrip("# ").split() for line in lines if line.startswith("#")]
        columns = next((head for head in heads if set(COLUMNS.values()) <= set(head)), None)
        rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
        if columns and rows:
            return {name: float(rows[-1][columns.index(word)]) for name, word in COLUMNS.items()}
    return None


def _vector(values: Sequence[float] | np.ndarray) -> str:
    """A vector in OpenFOAM's syntax."""
    return f"({' '.join(repr(float(value)) for value in values)})"
