"""Sensitivity to small errors of making and mounting: perturbed lenses, traced again with the same rays."""
