"""What stands around the light? The lens, its receivers and targets, and how a made part differs from the design.

- ``lens.Lens``: a lens: two faces and their spec
- ``section_arcs.FaceArc``: a face of a linear lens over the angles at which it bounds its medium
- ``receiver.PosedReceiver``: a receiver: where rays land on it
- ``receiver_shapes.receivers_of``: planes, cylinders, spheres and the far field of a spec
- ``pixel_grid.PixelGrid``: pixels, and flux on them
- ``target_pattern.target_light``: the light that is wanted, on pixels
- ``limit_readings.light_limits``: limits on light, as linear readings of a picture
- ``possible_light.PossibleLight``: the bounds on the light of any lens
- ``exit_rays.ExitRays``: rays that leave the lens
- ``perturbations.Draws``: errors of parts, drawn
- ``made_part.MadePart``: a part with its errors
- ``made_part.AsMade``: tilts, shifts and form errors along a ray
"""
