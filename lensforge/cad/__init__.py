"""Which body a lens is: patches, solid, base, mesh, and its STEP, STL and 3MF files. Nothing here knows light."""
