"""Bridges to frameworks that differentiate: grids, quality and measures as functions of arrays, with derivatives."""
