"""The paper: B-spline volumes fitted to a grid, control points moved, the grid regenerated, with derivatives."""
