"""The version, alone in a module so that every layer may state it."""

__version__ = "0.2.0"
