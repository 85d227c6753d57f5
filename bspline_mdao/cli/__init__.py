"""The command line ``bspline-mdao``."""
