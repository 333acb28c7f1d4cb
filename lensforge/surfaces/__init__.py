"""Shapes of faces: basis functions, aspheres, imported faces; each a radius over direction."""
