"""What becomes of the light in made parts: yield, sensitivity, measured parts, and a second cut."""
