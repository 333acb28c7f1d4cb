"""Receivers: exit rays become irradiance on pixels; and the irradiance that is wanted there."""
