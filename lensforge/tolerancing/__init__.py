"""Sensitivity to small manufacturing and alignment errors: perturbed lenses, traced again with the same rays."""
