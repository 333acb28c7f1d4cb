"""Emitters: where light starts. NumPy only."""
