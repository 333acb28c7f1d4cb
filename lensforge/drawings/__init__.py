"""What goes to the shop with the STEP file: drawing, datum, verdicts, tables of points, hashes."""
