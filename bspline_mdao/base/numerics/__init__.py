"""Processes, threads, memory, progress and small linear algebra, shared by all folders."""
