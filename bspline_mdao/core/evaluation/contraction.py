"""Which contraction of sub-nets the evaluation uses: emitted vector code, or the plain numba version.

The emitted code (`.simd_contraction`) is five times faster and uses parts of numba and llvmlite that may change between
versions. It is used if it was tested with the version of numba and a trial emission makes valid code. Otherwise
`.plain_contraction` is used, with a warning; setting ``BSPLINE_MDAO_PLAIN_KERNELS=1`` before the import selects it too.
Both have the same functions and constants.

Theory: ``docs/theory/evaluation.rst``.
"""

from __future__ import annotations

import os
import re
import warnings

import numba

TESTED = ((0, 61), (0, 69))
"""First version of numba that the emitted code supports, and the first beyond; as in ``pyproject.toml``."""

VARIABLE = "BSPLINE_MDAO_PLAIN_KERNELS"


def why_plain(version: str = numba.__version__) -> str | None:
    """Return why the emitted code cannot be used with a version of numba; None if it can."""
    major_minor = tuple(int(number) for number in re.findall(r"\d+", version)[:2])
    if not TESTED[0] <= major_minor < TESTED[1]:
        return f"numba {version} is not one of 0.{TESTED[0][1]} to 0.{TESTED[1][1] - 1}"
    try:
        from ...base.numerics.simd import check_emission  # not at the top: its imports may fail

        check_emission()
    except Exception as error:  # any error that a moved function of llvmlite raises
        return f"numba {version} does not emit vector code ({type(error).__name__}: {error})"
    return None


def _is_emitted() -> bool:
    if os.environ.get(VARIABLE, "0") != "0":
        return False
    reason = why_plain()
    if reason is not None:
        warnings.warn(f"evaluation: {reason}; plain kernels are used, several times slower", RuntimeWarning, 2)
    return reason is None


IS_EMITTED = _is_emitted()
"""Whether the emitted code is in use."""

if IS_EMITTED:
    from .simd_contraction import (
        LANES,
        MARGIN,
        SOURCE,
        TILE,
        add_net,
        gather_points,
        load_net,
        sum_over_net,
        sum_over_net_turned,
        sum_over_nodes,
        sum_turns,
    )
else:
    from .plain_contraction import (
        LANES,
        MARGIN,
        SOURCE,
        TILE,
        add_net,
        gather_points,
        load_net,
        sum_over_net,
        sum_over_net_turned,
        sum_over_nodes,
        sum_turns,
    )

__all__ = [
    "IS_EMITTED",
    "LANES",
    "MARGIN",
    "SOURCE",
    "TILE",
    "add_net",
    "gather_points",
    "load_net",
    "sum_over_net",
    "sum_over_net_turned",
    "sum_over_nodes",
    "sum_turns",
    "why_plain",
]
