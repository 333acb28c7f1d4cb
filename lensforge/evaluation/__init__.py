"""Evaluation of a finished lens: irradiance by hard bins, metrics with standard errors, and the flux budget."""
