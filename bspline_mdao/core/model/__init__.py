"""The fitted grid and its file: control points, parameters, residual and report."""
