"""The geometry stage: a lens record becomes a solid, a mesh and their files; NumPy, scipy and CAD, never torch.

CAD and mesh libraries load when one of their functions is first called.
"""
