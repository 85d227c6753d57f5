"""Capabilities of each NLopt algorithm, to refuse a problem before it runs and name suitable algorithms.

Theory: ``docs/theory/drivers.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from ....errors import InputError

__all__ = ["ALGORITHMS", "Algorithm", "Needs", "find_algorithm", "missing", "suitable"]

BoundsUse = Literal["taken", "needed", "ignored"]
Subsidiary = Literal["none", "optional", "needed"]
Recovery = Literal["nan", "uphill", "worst"]


@dataclass(frozen=True)
class Algorithm:
    """Capabilities of one algorithm."""

    name: str  # its name in NLopt, for example ``"LD_SLSQP"``
    title: str  # its method in a few words
    gradients: bool  # it uses gradients
    # it searches the whole box and, unless it is multi-start, ends only when its budget (evaluations, time or
    # ``stopval``) is spent
    is_global: bool
    # inequality, equality: it takes inequality, equality constraints
    inequality: bool = False
    equality: bool = False
    bounds: BoundsUse = "taken"  # whether it takes bounds, needs finite ones on every variable, or takes none
    local_optimizer: Subsidiary = "none"  # whether it runs another algorithm inside
    is_stochastic: bool = False  # it uses random numbers (option ``seed``)
    recovery: Recovery = "worst"  # value it is given if the analysis fails, see `nlopt_rules`
    min_variables: int = 1  # the fewest variables it works with
    is_compiled: bool = True  # false for names that NLopt lists and cannot run

    @property
    def hands_on_inequality(self) -> bool:
        """Inequality constraints are passed on to the local optimizer."""
        return self.name.endswith("AUGLAG_EQ")


@dataclass(frozen=True)
class Needs:
    """A problem's requirements of an algorithm."""

    n_variables: int  # number of design variables
    # inequality, equality: names of its inequality and equality constraints
    inequality: tuple[str, ...] = ()
    equality: tuple[str, ...] = ()
    bounded: tuple[str, ...] = ()  # names of the design variables with a finite bound
    unbounded: tuple[str, ...] = ()  # names of the design variables without a finite bound on both sides
    has_derivatives: bool = True  # whether the model was set up with derivatives

    def of_subsidiary(self, algorithm: Algorithm) -> Needs:
        """Requirements of the algorithm run inside another one."""
        inequality = self.inequality if algorithm.hands_on_inequality else ()
        return replace(self, inequality=inequality, equality=())


def _local(name: str, title: str, **capabilities: Any) -> Algorithm:
    """A local algorithm; its prefix says whether it uses gradients."""
    return Algorithm(name, title, name.startswith("LD"), is_global=False, **capabilities)


def _global(name: str, title: str, **capabilities: Any) -> Algorithm:
    """A global algorithm; all of them need a finite box."""
    return Algorithm(name, title, name.startswith("GD"), is_global=True, bounds="needed", **capabilities)


def _line_search(name: str, title: str) -> Algorithm:
    """A gradient algorithm that interpolates values and slopes along a line."""
    return _local(name, title, recovery="uphill")


def _lagrangian(name: str, title: str, local_optimizer: Subsidiary) -> Algorithm:
    """An augmented Lagrangian, which takes all constraints whatever its local optimizer takes."""
    return _local(name, title, inequality=True, equality=True, local_optimizer=local_optimizer, recovery="uphill")


def _multi_start(name: str, title: str, local_optimizer: Subsidiary, is_stochastic: bool) -> Algorithm:
    """A global algorithm that starts a local one at many points."""
    return _global(name, title, local_optimizer=local_optimizer, is_stochastic=is_stochastic, recovery="uphill")


_TABLE = (
    _local("LD_SLSQP", "sequential quadratic programming", inequality=True, equality=True, recovery="nan"),
    _local("LD_MMA", "method of moving asymptotes", inequality=True),
    _local("LD_CCSAQ", "conservative convex separable quadratic approximations", inequality=True),
    _line_search("LD_LBFGS", "limited-memory BFGS"),
    Algorithm("LD_LBFGS_NOCEDAL", "limited-memory BFGS by Nocedal", True, False, is_compiled=False),
    _line_search("LD_VAR1", "limited-memory variable metric, rank 1"),
    _line_search("LD_VAR2", "limited-memory variable metric, rank 2"),
    _line_search("LD_TNEWTON", "truncated Newton"),
    _line_search("LD_TNEWTON_RESTART", "truncated Newton with restarts"),
    _line_search("LD_TNEWTON_PRECOND", "preconditioned truncated Newton"),
    _line_search("LD_TNEWTON_PRECOND_RESTART", "preconditioned truncated Newton with restarts"),
    _lagrangian("AUGLAG", "augmented Lagrangian", "needed"),
    _lagrangian("AUGLAG_EQ", "augmented Lagrangian for equalities", "needed"),
    _lagrangian("LD_AUGLAG", "augmented Lagrangian, with gradients", "optional"),
    _lagrangian("LD_AUGLAG_EQ", "augmented Lagrangian for equalities, with gradients", "optional"),
    _lagrangian("LN_AUGLAG", "augmented Lagrangian, without gradients", "optional"),
    _lagrangian("LN_AUGLAG_EQ", "augmented Lagrangian for equalities, without gradients", "optional"),
    _local("LN_COBYLA", "linear approximations", inequality=True, equality=True),
    _local("LN_BOBYQA", "quadratic models within bounds", min_variables=2),
    _local("LN_NEWUOA", "quadratic models", bounds="ignored", min_variables=2),
    _local("LN_NEWUOA_BOUND", "quadratic models within bounds, superseded by BOBYQA", min_variables=2),
    _local("LN_PRAXIS", "principal axes", is_stochastic=True),
    _local("LN_NELDERMEAD", "simplex of Nelder and Mead"),
    _local("LN_SBPLX", "simplex on subspaces"),
    _multi_start("G_MLSL", "multi-level single linkage", "needed", is_stochastic=True),
    _multi_start("G_MLSL_LDS", "multi-level single linkage, low-discrepancy", "needed", is_stochastic=False),
    _multi_start("GD_MLSL", "multi-level single linkage, with gradients", "optional", is_stochastic=True),
    _multi_start("GD_MLSL_LDS", "multi-level single linkage, low-discrepancy, with gradients", "optional", False),
    _multi_start("GN_MLSL", "multi-level single linkage, without gradients", "optional", is_stochastic=True),
    _multi_start("GN_MLSL_LDS", "multi-level single linkage, low-discrepancy, without gradients", "optional", False),
    _global("GD_STOGO", "branch and bound with gradients", recovery="uphill"),
    _global("GD_STOGO_RAND", "branch and bound with gradients, randomised", is_stochastic=True, recovery="uphill"),
    _global("GN_DIRECT", "dividing rectangles"),
    _global("GN_DIRECT_L", "dividing rectangles, locally biased"),
    _global("GN_DIRECT_L_RAND", "dividing rectangles, locally biased, randomised", is_stochastic=True),
    _global("GN_DIRECT_NOSCAL", "dividing rectangles, unscaled"),
    _global("GN_DIRECT_L_NOSCAL", "dividing rectangles, locally biased, unscaled"),
    _global("GN_DIRECT_L_RAND_NOSCAL", "dividing rectangles, locally biased, randomised, unscaled", is_stochastic=True),
    _global("GN_ORIG_DIRECT", "dividing rectangles, original code", inequality=True),
    _global("GN_ORIG_DIRECT_L", "dividing rectangles, locally biased, original code", inequality=True),
    _global("GN_CRS2_LM", "controlled random search", is_stochastic=True),
    _global(
        "GN_ISRES", "evolution strategy with stochastic ranking", inequality=True, equality=True, is_stochastic=True
    ),
    _global("GN_ESCH", "evolution strategy", is_stochastic=True),
    _global("GN_AGS", "space-filling curves", inequality=True),
)

ALGORITHMS: dict[str, Algorithm] = {algorithm.name: algorithm for algorithm in _TABLE}
"""All algorithms by name, ones for many variables and constraints first."""


def _quoted(names: tuple[str, ...]) -> str:
    """The first few names in quotes."""
    return ", ".join(repr(name) for name in names[:3]) + (", ..." if len(names) > 3 else "")


def missing(algorithm: Algorithm, needs: Needs) -> str | None:
    """Say what an algorithm lacks for a problem, as the end of a sentence beginning with its name; None if nothing."""
    complaints = {
        "is not compiled into NLopt": not algorithm.is_compiled,
        "needs gradients, and the problem was set up with derivatives=False": algorithm.gradients
        and not needs.has_derivatives,
        f"takes no equality constraints ({_quoted(needs.equality)})": needs.equality and not algorithm.equality,
        f"takes no inequality constraints ({_quoted(needs.inequality)})": needs.inequality and not algorithm.inequality,
        f"ignores bounds ({_quoted(needs.bounded)})": needs.bounded and algorithm.bounds == "ignored",
        f"needs finite bounds on all design variables ({_quoted(needs.unbounded)})": needs.unbounded
        and algorithm.bounds == "needed",
        f"needs at least {algorithm.min_variables} design variables": needs.n_variables < algorithm.min_variables,
    }
    return next((text for text, is_true in complaints.items() if is_true), None)


def suitable(
    needs: Needs,  # requirements of the problem
) -> tuple[Algorithm, ...]:
    """Algorithms suitable for a problem, ones for many variables and constraints first."""
    return tuple(algorithm for algorithm in _TABLE if missing(algorithm, needs) is None)


def _alternatives(algorithm: Algorithm, needs: Needs, is_subsidiary: bool) -> str:
    """Names of suitable alternatives: local ones for a local algorithm, simple ones for a subsidiary, if any."""
    others = [other for other in suitable(needs) if not (is_subsidiary and other.local_optimizer != "none")]
    of_its_kind = [other for other in others if other.is_global == algorithm.is_global]
    names = [other.name for other in of_its_kind or others]
    return (", ".join(names[:12]) + (", ..." if len(names) > 12 else "")) or "none"


def find_algorithm(name: str, needs: Needs, *, is_subsidiary: bool = False) -> Algorithm:
    """Find an algorithm by name, and check that it meets a problem's requirements."""
    algorithm = ALGORITHMS[name]
    lack = missing(algorithm, needs)
    if lack is not None:
        role = "local_optimizer" if is_subsidiary else "optimizer"
        others = _alternatives(algorithm, needs, is_subsidiary)
        raise InputError(f"NLoptDriver: {role} {name} {lack}; possible ones: {others}")
    return algorithm
