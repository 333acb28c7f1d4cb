"""What light a lens makes: tracing, metrics, limits, far field and roads."""
