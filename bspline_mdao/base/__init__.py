"""The foundation of the package: numerics, sparse systems, texts and optional packages; no geometry."""
