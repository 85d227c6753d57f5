"""The control mesh that is moved: what its points may do, and its surface."""
