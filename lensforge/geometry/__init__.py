"""The geometry stage: solid, mesh and their files from a lens record; NumPy, scipy and CAD, never torch.

CAD and mesh libraries load when one of their functions is first called.
"""
