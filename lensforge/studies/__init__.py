"""Studies over many designs or settings: sweeps of a field, and what accuracy costs in time."""
