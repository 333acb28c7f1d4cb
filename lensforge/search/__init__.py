"""How a lens is found: problem, merit, constraints, stages, and the state of a search."""
