"""Shapes of refracting surfaces: NumPy and SciPy, so that the geometry stage never needs torch."""
