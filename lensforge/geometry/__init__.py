"""From the lens record to a solid, a mesh and their files; NumPy, scipy and CAD, never torch.

CAD and mesh libraries load when one of their functions is first called.
"""

from lensforge.geometry.export import export_lens
from lensforge.geometry.grading import MeshTolerance
from lensforge.geometry.mesh import BodyMesh, build_mesh
from lensforge.geometry.patch import Patch, fit_patch
from lensforge.geometry.plan import Plan, make_plan

__all__ = ["BodyMesh", "MeshTolerance", "Patch", "Plan", "build_mesh", "export_lens", "fit_patch", "make_plan"]
