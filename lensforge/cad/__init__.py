"""The body of a lens: patches, solid, base, mesh, and its STEP, STL and 3MF files. Nothing here knows light."""
