"""Changes of the light besides noise that every cast of a part allows."""

# Share of flux: rays that graze the rim or the limit of total reflection may end either way.
FLUX_SHARE = 1e-3
NOISE_ALLOWANCE = 1e-3  # of the NMSE against the design's irradiance
