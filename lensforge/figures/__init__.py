"""Drawing for scripts and notebooks: plain plots of arrays, on axes of the caller's or on new ones."""
