"""Ray files of vendors: one module for each format, and what all of them have in common."""
