"""Light sources: emitters, ray files and photometric files; NumPy and SciPy, without torch."""
