"""Whether the part can be cut, and with what."""
