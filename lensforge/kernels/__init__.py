"""Compiled kernels, and how they run on every core; cached under a digest of this folder."""
