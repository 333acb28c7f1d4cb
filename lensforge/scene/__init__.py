"""What a lens stands in: the lens itself, its receivers and targets, and how a made part differs from the design."""
