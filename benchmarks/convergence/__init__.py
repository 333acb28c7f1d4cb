"""Convergence studies of the program's own numerics: rays, tables, pixels, filter, faces, mesh, search."""
