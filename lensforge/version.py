"""The version, in a module of its own that every layer can import."""

__version__ = "0.2.0"
