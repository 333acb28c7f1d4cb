"""Manufacture: can the part be made, and with what; drawing, tables and point files for the shop."""
