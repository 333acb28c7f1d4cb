"""Proof by code that shares nothing with the design stage: a ray cast of the exported file."""
