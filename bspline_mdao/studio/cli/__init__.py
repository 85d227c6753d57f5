"""The command line: ``bspline-mdao`` and its commands."""
