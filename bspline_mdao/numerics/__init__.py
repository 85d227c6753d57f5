"""Ground that everything stands on: threads, SIMD instructions, vectors, and transfinite interpolation."""
