"""Optimisation: parameters, constraints and merit function of a lens, and the search that minimises it."""
