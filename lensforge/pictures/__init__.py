"""Pictures from anywhere as light: targets, photographs and luminance images are read here, and nowhere else."""
