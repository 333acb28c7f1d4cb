"""The machined part against its design: a photograph of its light, and points measured on its surfaces."""
