"""Surfaces for CAD: tensor B-splines of the walls, their topology, and IGES and STEP files."""
