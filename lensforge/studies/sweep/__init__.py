"""One design for each of several values of a field: what a smaller lens, or another distance, does to the light."""
