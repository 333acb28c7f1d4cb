"""A shape from a STEP file lies within ten metres of the origin, in each of six directions."""

import pytest
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
from OCP.gp import gp_Pnt

from lensforge.errors import InputError
from lensforge.surfaces.step_file import _require_usable


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_shape_that_reaches_too_far_in_any_direction_is_refused(axis: int, sign: float) -> None:
    for reach_mm, allowed in ((9_990.0, True), (10_010.0, False)):
        low = [-1.0, -1.0, -1.0]
        high = [1.0, 1.0, 1.0]
        (high if sign > 0.0 else low)[axis] = sign * reach_mm
        box = BRepPrimAPI_MakeBox(gp_Pnt(*low), gp_Pnt(*high)).Shape()
        if allowed:
            _require_usable(box, 6, "base.step", "give another", False)
            continue
        with pytest.raises(InputError, match=r"base\.step: its shape has no extent, or reaches beyond 10000 mm"):
            _require_usable(box, 6, "base.step", "give another", False)
