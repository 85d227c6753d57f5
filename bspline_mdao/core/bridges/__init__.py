"""Bridges to differentiating frameworks: grids, quality and measures as functions of arrays, with derivatives."""
