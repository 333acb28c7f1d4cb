"""Which solid is the lens? Patches, solid, base and mesh, and its STEP, STL and 3MF files. Nothing here knows light.

- ``part_export.build_part``: the part of a lens, files included, read back and measured
- ``part.Part``: its result
- ``patch.fit_patch``: a face as a NURBS patch
- ``plan.lay_out``: faces and base of a body
- ``solid``: the solid, face by face
- ``custom_base.read_custom_base``: a base from a STEP file
- ``mesh.build_mesh``: the mesh, and its error
- ``step``: STEP files
- ``form_error.face_error``: how far the exported face is from the exact one
- ``wall.thinnest``: the thinnest wall along the normal
- ``plate_export.build_plate``: the plate that carries several lenses in one piece
- ``keep_out``: room for other parts
"""
