"""From hits to irradiance, and from irradiance to a number."""
