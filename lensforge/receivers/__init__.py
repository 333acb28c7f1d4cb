"""From exit rays to irradiance, and from irradiance to a number."""
