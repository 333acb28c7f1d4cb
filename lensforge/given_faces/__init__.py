"""Optical faces that are given: those of another lens, of a CAD file, or through points."""
