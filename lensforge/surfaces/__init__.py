"""Shapes of light-bending surfaces: NumPy only, so that the geometry stage never needs torch."""
