"""Studies in TOML: what their keys are, how they are read, and the Python scripts that they stand for."""
