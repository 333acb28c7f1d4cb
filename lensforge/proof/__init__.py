"""Does the exported part do what was designed? Casts that share no tracing code with the design.

- ``casts.verify``: the verb of the library
- ``casts.stray_light``: reflections, base and absorption
- ``proof_result.Proof``: result of the first
- ``proof_result.StrayLight``: result of the second
- ``sequential_cast``: rays through mesh or STEP, face after face
- ``nonsequential_trace``: rays wherever they go, and what that shows which the design leaves out
- ``step_cast``: hits on the B-rep itself
- ``trimesh_cast``: hits on the mesh
- ``mitsuba_cast``: hits by Mitsuba
- ``independent_draws``: rays of a source, drawn anew from its section
- ``receiver_screen``: receivers as the proof sees them
- ``acceptance``: limits on what the casts may differ by
"""
