"""Volume and area of solids whose closed forms are known, on the kernel's own surfaces and as splines."""

import cadquery as cq
import numpy as np
import pytest

from lensforge.results.brep_size import volume_and_area

DRILLED = cq.Workplane().box(6.0, 4.0, 3.0).faces(">Z").workplane().center(1.2, -0.4).hole(1.5)
TUBE = 2.0 * np.pi * 0.75 * 3.0
SOLIDS = {
    "drilled": (DRILLED, 72.0 - np.pi * 0.75**2 * 3.0, 108.0 - 2.0 * np.pi * 0.75**2 + TUBE),
    "ball": (cq.Workplane().sphere(2.5).translate((1.0, 2.0, 3.0)), 4.0 / 3.0 * np.pi * 2.5**3, 4.0 * np.pi * 2.5**2),
    "ring": (
        cq.Workplane().add(cq.Solid.makeTorus(5.0, 1.5)), 2.0 * np.pi**2 * 5.0 * 1.5**2, 4.0 * np.pi**2 * 5.0 * 1.5,
    ),
}  # fmt: skip


def as_splines(shape):
    from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert

    return BRepBuilderAPI_NurbsConvert(shape, True).Shape()


@pytest.mark.usefixtures("full_effort")
@pytest.mark.parametrize("name", SOLIDS)
def test_size_is_that_of_the_closed_form(name):
    body, volume, area = SOLIDS[name]
    for shape in (body.val().wrapped, as_splines(body.val().wrapped)):
        for sign, each in ((1.0, shape), (-1.0, shape.Reversed())):  # the faces of a reversed one face inwards
            assert volume_and_area(each) == (pytest.approx(sign * volume, rel=2e-6), pytest.approx(area, rel=2e-6))
