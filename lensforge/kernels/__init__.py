"""Compiled code: first hits of tables, the path of rays and its adjoint, splines, landing on receivers."""
