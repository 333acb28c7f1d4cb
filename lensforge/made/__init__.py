"""What will the made parts do, and what did this one do? Yield, sensitivity, measured parts, and a second cut.

- ``part_verbs.sensitivity``: the effect of each error
- ``part_verbs.tolerance``: parts drawn from the tolerances
- ``part_verbs.compare``: a photograph or points of a part against its design
- ``part_verbs.correct``: a face for a second cut
- ``tolerance_result.Yield``: the share that passes, and why others do not
- ``yield_study``: parts, rays and their noise
- ``tolerance_budget``: how large each tolerance may be
- ``measured_surface``: form deviation of measured points
- ``photo_comparison``: a photograph and the simulated light
- ``correction``: the corrected face
"""
