"""Snell, Fresnel and materials: pure functions."""
