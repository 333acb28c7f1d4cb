"""The surroundings of light: the lens, its receivers and targets, and how a made part differs from the design."""
