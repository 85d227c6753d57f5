"""Exceptions and warnings: unusable input, failed movements and solvers, doubtful fits and flows."""

__all__ = [
    "DerivativeModeWarning",
    "FitWarning",
    "InputError",
    "MachNumberWarning",
    "MovementError",
    "ReferenceWarning",
    "SolverError",
    "SpuriousDragWarning",
]


class InputError(ValueError):
    """Input that cannot be used: a file, an option, an array or a combination of them.

    The message is one line that says what is wrong, where (file, block, index) and what to do. The command line
    prints it as it is and exits with status 2.

    Examples
    --------
    >>> from bspline_mdao import InputError
    >>> from bspline_mdao.generators import brick_grid
    >>> try:
    ...     brick_grid((1, 5, 5, 5))
    ... except InputError as error:
    ...     print(len(str(error).splitlines()), "line")  # what is wrong, where, and what to do
    1 line
    """


class MovementError(ArithmeticError):
    """A move that is not possible: no mesh can follow the request, or a system has no solution.

    The message is one line that says where (increment, block, index) and what to do. Components raise it as
    ``om.AnalysisError``, so that a driver takes a smaller step.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import MovementError, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.movers import LinearElasticity, moving_mesh
    >>> mesh = moving_mesh(fit_grid(brick_grid((5, 5, 5, 5))))
    >>> try:
    ...     LinearElasticity(mesh, n_increments=1).move(mesh.points, np.nan * mesh.points[mesh.surface_ids])
    ... except MovementError:
    ...     "refused"
    'refused'
    """


class SolverError(RuntimeError):
    """An external flow solver without a solution: it is missing, diverged, was killed or took too long.

    The first line of the message says which program failed, where, why and what to do. The last lines of the log
    follow. Components raise it as ``om.AnalysisError``, so that a driver takes a smaller step.

    Examples
    --------
    >>> from bspline_mdao import SolverError
    >>> try:
    ...     raise SolverError("simpleFoam is not on the PATH; install OpenFOAM")
    ... except SolverError as error:
    ...     print(error)
    simpleFoam is not on the PATH; install OpenFOAM
    """


class FitWarning(UserWarning):
    """A usable fit whose control mesh has invalid elements, on which movers may fail.

    `fit_grid` gives one such warning per fit, at the line that called it. The message is one line that gives the number
    of elements, the location of the worst and what to do. The report of the model contains it as well.

    Examples
    --------
    >>> from bspline_mdao import FitWarning, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> import warnings
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", FitWarning)  # a fit that movers may not survive is an error
    ...     fit_grid(brick_grid((5, 5, 5, 5))).n_nodes
    750
    """


class SpuriousDragWarning(UserWarning):
    """A drag in an objective or a constraint of which more than a tenth is a discretization error.

    `EulerFlow` gives one such warning per problem, when it first runs. The message is one line that gives the parts of
    the drag and what to do.

    Examples
    --------
    >>> from bspline_mdao import SpuriousDragWarning
    >>> import warnings
    >>> warnings.simplefilter("ignore", SpuriousDragWarning)  # silences it
    """


class DerivativeModeWarning(UserWarning):
    """Gradients take at least twice as many linear solves of the flow as in the other mode.

    `EulerFlow` gives one such warning per problem, with its first gradient. The message is one line that gives the
    number of solves in both modes, and which mode to set up.

    Examples
    --------
    >>> from bspline_mdao import DerivativeModeWarning
    >>> import warnings
    >>> warnings.simplefilter("error", DerivativeModeWarning)  # stop a script that runs in the slow mode
    """


class MachNumberWarning(UserWarning):
    """A Mach number outside the range validated against exact solutions, other codes or measurements.

    `EulerFlow` and the vortex lattice give one such warning per problem, when they first run at such a number. The
    message is one line that gives the validated range.

    Examples
    --------
    >>> from bspline_mdao import MachNumberWarning
    >>> import warnings
    >>> warnings.simplefilter("ignore", MachNumberWarning)  # once you have checked it
    """


class ReferenceWarning(UserWarning):
    """Doubtful reference values of a flow: axes, a reference area, or forces that differ from the solver's.

    `OpenFoamFlow` gives one such warning for each doubt, after its first solution. `LatticeFlow` and `EulerFlow` give
    one of a reference area that is far from the walls'. The message is one line with the numbers. Nothing is refused,
    since all of it may be intended.

    Examples
    --------
    >>> from bspline_mdao.flow import ReferenceWarning
    >>> import warnings
    >>> warnings.simplefilter("ignore", ReferenceWarning)  # once you have checked them
    """
