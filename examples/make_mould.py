"""Write examples/mould.step, the core pin of an old mould: examples/fixed_step_face.toml takes its dome as the cavity.

The dome is half of an ellipsoid, 12.8 mm by 10.8 mm wide and 6 mm high, on a block of 20 mm.

python examples/make_mould.py
"""

from pathlib import Path

import cadquery as cq
from OCP.BRepBuilderAPI import BRepBuilderAPI_GTransform
from OCP.gp import gp_GTrsf, gp_Mat, gp_XYZ

SEMI_AXES_MM = (6.4, 5.4, 6.0)


def core_pin() -> cq.Workplane:
    """The pin as one solid, its parting plane at z = 0."""
    scaling = gp_GTrsf(gp_Mat(*(SEMI_AXES_MM[i] if i == j else 0.0 for i in range(3) for j in range(3))), gp_XYZ())
    dome = cq.Shape.cast(BRepBuilderAPI_GTransform(cq.Solid.makeSphere(1.0).wrapped, scaling).Shape())
    above = cq.Solid.makeBox(40.0, 40.0, 20.0, cq.Vector(-20.0, -20.0, 0.0))
    block = cq.Workplane("XY").box(20.0, 20.0, 5.0).translate((0.0, 0.0, -2.5))
    return block.union(cq.Workplane(obj=above.intersect(dome)))


if __name__ == "__main__":
    cq.exporters.export(core_pin(), str(Path(__file__).with_name("mould.step")))
