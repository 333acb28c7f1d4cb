"""How is a lens found? Problem, merit, constraints, stages, and the state of a search.

- ``searches.design``: the verb of the library
- ``optimiser.search``: one search, from hemispheres to a lens
- ``problem``: the scene of a search, level by level
- ``start_faces``: the faces from which a search begins
- ``parameters.Parametrisation``: weights to tables
- ``light_path``: rays to pixels, with their gradient
- ``merit.MeritFunction``: what is minimised
- ``limit_terms``: its part of the limits on the light
- ``constraints``: limits of shape, by sequential unconstrained minimisation
- ``face_fields``: curvature, draft and wall, with their derivatives
- ``feasibility``: projection onto the constraints
- ``schedule``: levels and stages as data
- ``automatic_schedule``: levels and stages that a search chooses
- ``checkpoint``: a search that goes on after a kill, to the same bits
- ``design_result.Design``: its result
"""
