"""Better grids of the same surface by moving interior control points (sections II.E and V)."""
