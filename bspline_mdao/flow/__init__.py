"""Flow about the shape: the Euler equations, forces, span loads and induced drag, as kernels."""
