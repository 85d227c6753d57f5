"""The exceptions of the package: unusable input, and a movement that cannot be done."""

__all__ = ["InputError", "MovementError"]


class InputError(ValueError):
    """Input that cannot be used: a file, an option, an array or a combination of them.

    The message is one line that says what is wrong, where (file, block, index) and what to do. The command line
    prints it as it is and exits with status 2.
    """


class MovementError(ArithmeticError):
    """A movement that cannot be done: a request that no mesh can follow, or a system that has no solution.

    The message is one line that says where (increment, block, index) and what to do. Components raise it as
    ``om.AnalysisError``, so that a driver takes a smaller step.
    """
