"""The beginning of light: emitters, measured ray files and photometric files, as rays with flux and wavelength."""
