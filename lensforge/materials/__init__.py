"""Materials of lenses: dispersion formulas, a catalogue, and readers of the files of others."""
