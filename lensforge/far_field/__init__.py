"""The finished lens as a luminaire: what it sends where, for the programs that plan with it."""
