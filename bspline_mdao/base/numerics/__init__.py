"""Processes, threads, memory, progress and small linear algebra: what all folders share."""
