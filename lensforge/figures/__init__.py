"""Plots of arrays for scripts and notebooks, on the caller's axes or new ones, and the unit of light."""
