"""Area and box of the part as exported: what its files are compared with when they come back from elsewhere."""

from lensforge.geometry.mesh import BodyMesh
from lensforge.geometry.solid import Solid
from lensforge.records import Box

_AREA_PRECISION = 1e-4  # relative; the error is 1e-9 on a lens, and without any setting 1e-6


def solid_area_mm2(solid: Solid) -> float:
    """Area (mm^2) of all faces of ``solid``, by adaptive integration over them."""
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(solid.shape.wrapped, properties, _AREA_PRECISION)
    return float(properties.Mass())


def mesh_bounds_mm(mesh: BodyMesh) -> Box:
    """Least and largest corner (mm) of the box around the vertices of ``mesh``."""
    (x0, y0, z0), (x1, y1, z1) = mesh.vertices.min(axis=0).tolist(), mesh.vertices.max(axis=0).tolist()
    return (x0, y0, z0), (x1, y1, z1)
