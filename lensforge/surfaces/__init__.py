"""What shape does a face have? Each is a radius over direction.

- ``surface.Surface``: what a shape answers: radius and slope
- ``srbf.SrbfSurface``: a freeform face of spherical radial basis functions
- ``asphere``: conics, aspheres and biconics
- ``imported_face``: a face of a STEP file, a point cloud or another lens
- ``chart_spline.ChartSpline``: a spline over the chart of directions
- ``bicubic_table.TableGrid``: tables through which rays are traced
- ``mirror_group.group``: symmetries
- ``placed_bodies``: given bodies in their places
- ``cad_sampling``: faces of CAD files as points
"""

from lensforge.surfaces import asphere, chart_spline, profile, reciprocal, srbf  # each registers its records

__all__ = ["asphere", "chart_spline", "profile", "reciprocal", "srbf"]
