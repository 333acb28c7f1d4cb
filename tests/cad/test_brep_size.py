"""Volume and area of solids whose closed forms are known, on the kernel's own surfaces and as splines."""

import cadquery as cq
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import make_interp_spline

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


@pytest.mark.parametrize("name", SOLIDS)
def test_size_is_that_of_the_closed_form(name):
    body, volume, area = SOLIDS[name]
    for shape in (body.val().wrapped, as_splines(body.val().wrapped)):
        for sign, solid in ((1.0, shape), (-1.0, shape.Reversed())):  # the faces of a reversed one face inwards
            assert volume_and_area(solid) == (pytest.approx(sign * volume, rel=2e-6), pytest.approx(area, rel=2e-6))


def rippled_strip(height_mm, per_mm, knots):
    """A strip 2 mm long and 1 mm wide at z = 1, whose ripples run along x: quintic there, straight across."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.Geom import Geom_BSplineSurface
    from OCP.gp import gp_Pnt
    from OCP.TColgp import TColgp_Array2OfPnt
    from OCP.TColStd import TColStd_Array1OfInteger, TColStd_Array1OfReal

    x = np.linspace(-1.0, 1.0, knots)
    line = make_interp_spline(x, np.column_stack([x, 1.0 + height_mm * np.sin(per_mm * x)]), k=5)
    poles = TColgp_Array2OfPnt(1, len(line.c), 1, 2)
    for row, (along, up) in enumerate(line.c.tolist(), start=1):
        for column, across in ((1, 0.0), (2, 1.0)):
            poles.SetValue(row, column, gp_Pnt(along, across, up))

    def array(kind, values):
        made = kind(1, len(values))
        for k, value in enumerate(values, start=1):
            made.SetValue(k, value)
        return made

    distinct, counts = np.unique(line.t, return_counts=True)
    surface = Geom_BSplineSurface(
        poles,
        *(array(TColStd_Array1OfReal, ends) for ends in (distinct.tolist(), [0.0, 1.0])),
        *(array(TColStd_Array1OfInteger, ends) for ends in (counts.tolist(), [2, 2])),
        5,
        1,
    )
    return BRepBuilderAPI_MakeFace(surface, 1e-7).Face()


def test_ripples_as_fine_as_the_knots_have_their_area():
    height_mm = 0.004
    per_mm = 150.0
    area, _ = quad(lambda x: np.hypot(1.0, height_mm * per_mm * np.cos(per_mm * x)), -1.0, 1.0, limit=500)
    assert volume_and_area(rippled_strip(height_mm, per_mm, 400))[1] == pytest.approx(area, rel=1e-5)
