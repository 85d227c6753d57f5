"""Flows on grids that move: the Euler solver and its adjoint, loads, the vortex lattice, and their components."""
