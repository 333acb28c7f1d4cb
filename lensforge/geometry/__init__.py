"""From the lens record to a solid, a mesh and their files; NumPy, scipy and CAD, never torch."""
