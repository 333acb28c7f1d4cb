"""Made parts and their light: yield, sensitivity, measured parts, and a second cut."""
