"""The handover: drawing, datum, verdicts, tables of points and hashes that go to the shop with the STEP file."""
