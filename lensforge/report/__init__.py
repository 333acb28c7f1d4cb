"""Results as pages and plots, and in a notebook."""
