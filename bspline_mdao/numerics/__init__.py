"""Ground that everything stands on: threads, SIMD lanes, vectors of three and planes."""
