"""The way to a lens: problem, merit, constraints, stages, and the state of a search."""
