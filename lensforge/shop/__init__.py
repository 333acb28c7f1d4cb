"""Can it be made, and what does the shop need: check, drawing, point tables."""
