"""Lighting of roads and areas by a lamp: distribution type, BUG rating, classes of EN 13201."""
