"""Tracing: a ray bundle becomes the rays that leave the lens, every ray with a fate."""
