"""The control mesh that is moved: the freedom of its points, and its surface."""
