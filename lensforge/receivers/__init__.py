"""Receivers, on which exit rays become irradiance, and target patterns."""
