"""Which solver to use when nobody has said."""

from .cholesky import Cholesky

__all__ = ["default_solver"]


def default_solver():
    """Best direct solver of those installed: our own `Cholesky`."""
    return Cholesky()
