"""Compiled kernels: all that loops over rays, and how it runs on every core. Cached by a digest of this folder."""
