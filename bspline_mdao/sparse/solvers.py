"""The solver to use when nobody has said which."""

from __future__ import annotations

from .cholesky import Cholesky

__all__ = ["default_solver"]


def default_solver() -> Cholesky:
    """Best direct solver of those installed.

    That is our own `Cholesky`, whatever else is there: on control meshes it takes less time than CHOLMOD and PARDISO
    (``benchmarks/bench_cholesky.py``).
    """
    return Cholesky()
