"""The one exception for unusable input."""

__all__ = ["InputError"]


class InputError(ValueError):
    """Input that cannot be used: a file, an option, an array or a combination of them.

    The message is one line that says what is wrong, where (file, block, index) and what to do. The command line
    prints it as it is and exits with status 2.
    """
