"""Optimisation drivers for OpenMDAO."""
