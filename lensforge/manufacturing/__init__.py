"""The manufacturing check: can the part be cut, and with which tools."""
