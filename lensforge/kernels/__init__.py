"""How does a ray run through tabulated faces, and what does the light change by? Compiled code.

- ``bicubic.SurfaceBounds``: bounds of a table by which a first hit is proven
- ``first_hit``: the first crossing of a ray and a face
- ``nearly_convex``: the same at once for a face in a chain, where one number of the face tells it
- ``trace``: rays through both faces, in packets of ``ray_packet`` that vector instructions take at once
- ``adjoint``: gradients of what trace computes, backwards along each ray
- ``fresnel``: refraction, transmittance, coatings
- ``landing``: receivers, and their adjoint
- ``triangle_tree``, ``rims``: bodies of a scene that rays meet, or pass closely, by eight boxes at once (``lanes``)
- ``image_sums``: flux on pixels, and its adjoint
- ``spline_patch``: points of a spline in space, for CAD
- ``sparse.SparseMatrix``: a sparse matrix times a column for each face, for the search
- ``clearance``: a ball along a face
- ``face_shape``: curvature and draft of a face, and their adjoint
- ``fate.Fate``: what became of a ray
- ``precision``: the same kernels with numbers of 32 bits, for a search
- ``parallel.in_chunks``: work on several threads, summed in one order
"""
