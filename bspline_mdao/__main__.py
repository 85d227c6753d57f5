"""Run the command line as ``python -m bspline_mdao``."""

from .studio.cli.main import main

if __name__ == "__main__":
    main()
