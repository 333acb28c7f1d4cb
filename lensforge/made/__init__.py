"""What will the made parts do? Yield, sensitivity, and how large each tolerance may be.

- ``part_verbs.sensitivity``: the effect of each error
- ``part_verbs.tolerance``: parts drawn from the tolerances
- ``tolerance_result.Yield``: the share that passes, and why others do not
- ``yield_study``: parts, rays and their noise
- ``tolerance_budget``: how large each tolerance may be
"""
