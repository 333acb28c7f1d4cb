"""From a ray bundle to the rays that leave the lens, every ray with a fate."""
