"""Foundations of all layers: numbers, sparse systems, texts and optional packages; no geometry."""
