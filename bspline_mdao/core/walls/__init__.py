"""The grid near walls: the residual of the fit turned with its neighbourhood, and layers that follow walls."""
