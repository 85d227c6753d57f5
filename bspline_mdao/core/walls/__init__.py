"""The grid near walls: the residual of the fit turned with its surroundings, and layers that follow walls."""
