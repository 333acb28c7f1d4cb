"""What small errors of making and mounting do to the light: perturbed lenses, traced again with the same rays."""
