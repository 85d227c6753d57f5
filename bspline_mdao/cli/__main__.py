"""Runs the command line as ``python -m bspline_mdao.cli``."""

from .main import main

if __name__ == "__main__":
    main()
