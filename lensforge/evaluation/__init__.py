"""Evaluation of a finished lens: irradiance by hard bins, metrics with standard errors, every ray accounted for."""
