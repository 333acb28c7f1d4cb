"""The finished lens, judged: irradiance by hard bins, metrics with their standard errors, every ray accounted for."""
