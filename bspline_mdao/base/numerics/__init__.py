"""Common ground: threads, SIMD instructions, vectors, and transfinite interpolation."""
