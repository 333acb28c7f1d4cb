"""Vendors' ray files: one module for each format, each registers itself."""
