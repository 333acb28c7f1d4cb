"""The search for the lens."""
