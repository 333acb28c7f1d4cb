"""Targets: what is wanted on a receiver, as relative light on its pixels."""
