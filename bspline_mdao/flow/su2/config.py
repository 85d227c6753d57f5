"""Configurations of SU2: a user's own is kept, except for the keys that a run must set."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ...base.display import OneLine
from ...errors import InputError

__all__ = ["EULER", "Su2Config", "listed"]

EULER = """\
% The Euler equations by a second-order scheme of Roe: what runs where no configuration is given.
SOLVER= EULER
CONV_NUM_METHOD_FLOW= ROE
MUSCL_FLOW= YES
SLOPE_LIMITER_FLOW= NONE
NUM_METHOD_GRAD= GREEN_GAUSS
TIME_DISCRE_FLOW= EULER_IMPLICIT
LINEAR_SOLVER= FGMRES
LINEAR_SOLVER_PREC= ILU
LINEAR_SOLVER_ERROR= 1E-2
LINEAR_SOLVER_ITER= 10
CFL_NUMBER= 20.0
ITER= 3000
CONV_RESIDUAL_MINVAL= -11
"""

BOUNDARIES = {"symmetry": "MARKER_SYM", "farfield": "MARKER_FAR"}
"""Keys of the conditions by kind of marker; walls have `SLIP` or `NO_SLIP`."""

SLIP, NO_SLIP = "MARKER_EULER", "MARKER_HEATFLUX"
"""Walls without friction, and with it: for these each marker is followed by the heat flux, 0 here."""

VISCOUS = ("NAVIER_STOKES", "RANS")
"""Solvers with friction."""

SOLVERS = ("EULER", *VISCOUS)
"""Solvers that use a Mach number and an angle of attack."""

REFUSED = {
    "FIXED_CL_MODE": "the angle of attack is an input here: give it, and lift as a constraint or a balance",
    "TIME_DOMAIN": "flows are steady here",
    "MULTIZONE": "there is one mesh here",
}
"""Switches that change the inputs, and why they must be off."""

_KEY = re.compile(r"^\s*([A-Za-z][A-Za-z0-9_]*)\s*=(.*)$", re.S)


def listed(value: str) -> list[str]:
    """Words of a list such as ``( wing, body )``."""
    return [word for word in re.split(r"[\s,()]+", value) if word]


@dataclass(frozen=True, eq=False)
class Su2Config(OneLine):
    """A configuration."""

    text: str
    source: str  # name of its file, for messages

    @classmethod
    def read(cls, path: str | os.PathLike | None) -> Su2Config:
        """Read a user's file; `EULER` if there is none."""
        if path is None:
            return cls(EULER, "the configuration of the Euler equations")
        try:
            return cls(Path(path).read_text(encoding="utf-8", errors="replace"), os.fspath(path))
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}); name a configuration of SU2") from error

    @cached_property
    def statements(self) -> list[tuple[str, str]]:
        """Key, empty if there is none, and text of each statement: a line, and its continuation lines."""
        found, lines = [], iter(self.text.splitlines())
        for line in lines:
            whole = line
            while whole.split("%")[0].rstrip().endswith("\\"):
                rest = next(lines, None)
                if rest is None:
                    break
                whole += "\n" + rest
            match = _KEY.match(whole)
            found.append((match[1].upper() if match else "", whole))
        return found

    @cached_property
    def values(self) -> dict[str, str]:
        """Values by their keys, without comments."""
        found = {}
        for key, text in self.statements:
            if key:
                match = _KEY.match("\n".join(line.split("%")[0].rstrip().rstrip("\\") for line in text.splitlines()))
                assert match is not None
                found[key] = " ".join(match[2].split())
        return found

    def check(self, walls: Sequence[str]) -> None:
        """Refuse unsupported settings, and forces of other walls than those that move."""
        solver = self.values.get("SOLVER", "").upper()
        if solver not in SOLVERS:
            raise InputError(f"{self.source}: SOLVER= {solver or 'nothing'}; set one of {', '.join(SOLVERS)}")
        for key, why in REFUSED.items():
            if self.values.get(key, "NO").upper() == "YES":
                raise InputError(f"{self.source}: {key}= YES, but {why}; set it to NO")
        monitored = listed(self.values.get("MARKER_MONITORING", " ".join(walls)))
        missing = [name for name in walls if name not in monitored]
        if missing:
            raise InputError(
                f"{self.source}: MARKER_MONITORING has no '{missing[0]}', so that forces would lack that wall; add it, "
                f"or leave the key out"
            )

    @property
    def is_viscous(self) -> bool:
        """Whether there is friction."""
        return self.values["SOLVER"].upper() in VISCOUS

    @property
    def mach_is_alone(self) -> bool:
        """Whether a change of the Mach number changes no other property of the stream."""
        # SU2 has Reynolds numbers by default, and computes the density of the stream from them and its speed.
        return not self.is_viscous or self.values.get("INIT_OPTION", "REYNOLDS").upper() == "TD_CONDITIONS"

    def boundaries(self, kinds: Mapping[str, str]) -> dict[str, str]:
        """Conditions on the markers by kind; none if the configuration has its own."""
        of_walls = NO_SLIP if self.is_viscous else SLIP
        if any(key in self.values for key in (*BOUNDARIES.values(), SLIP, NO_SLIP, "MARKER_ISOTHERMAL")):
            return {}
        found: dict[str, list[str]] = {}
        for name, kind in kinds.items():
            if kind != "wall" and kind not in BOUNDARIES:
                raise InputError(
                    f"marker '{name}' is of kind {kind}, for which SU2 has several conditions; give a configuration "
                    f"with conditions on all markers, such as MARKER_FAR= ( {name} )"
                )
            parts = found.setdefault(of_walls if kind == "wall" else BOUNDARIES[kind], [])
            parts.append(f"{name}, 0.0" if kind == "wall" and self.is_viscous else name)
        return {key: f"( {', '.join(names)} )" for key, names in found.items()}

    def replaced_by(self, settings: Mapping[str, object]) -> list[str]:
        """Keys of the configuration that settings replace by other values."""
        return [key for key, value in settings.items() if key in self.values and self.values[key] != str(value)]

    def with_settings(self, settings: Mapping[str, object]) -> str:
        """Text with settings in place of its own, which stay as comments."""
        lines = []
        for key, text in self.statements:
            lines += [f"% replaced: {line}" for line in text.splitlines()] if key in settings else [text]
        return "\n".join(
            [*lines, "% set by bspline_mdao:", *(f"{key}= {value}" for key, value in settings.items()), ""]
        )
