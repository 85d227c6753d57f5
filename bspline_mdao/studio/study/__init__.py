"""Studies in TOML: their keys, their reader, and the Python scripts that they stand for."""
