"""The light of a lens: tracing, metrics, limits, far field and roads."""
