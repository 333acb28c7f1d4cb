"""Parts as they will be made and mounted: what the tolerances of a spec allow, drawn for each part, and its tables."""
