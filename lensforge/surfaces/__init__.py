"""Which shape a face has: basis functions, aspheres, imported faces; each a radius over direction."""
