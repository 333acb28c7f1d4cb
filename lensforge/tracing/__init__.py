"""From a ray bundle to its hits on the receiver, every ray with a fate."""
