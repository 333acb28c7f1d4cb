import numpy as np
import pytest
from geometry_lenses import random_surface

from lensforge.cad.outline import FULL_TURN
from lensforge.cad.patch import fit_patch
from lensforge.cad.plan import make_plan, rim_directions
from lensforge.errors import InputError
from lensforge.spec import BaseSection
from lensforge.surfaces.srbf import SrbfSurface

INCH = BaseSection()


def plan_of(inner, outer, base=INCH):
    return make_plan(fit_patch(inner), fit_patch(outer), base)


def sphere(radius):
    return random_surface(radius, 0.0, seed=0)


def test_arcs_go_once_around_and_change_over_exactly_on_the_cylinder():
    plan = plan_of(sphere(6.0), random_surface(12.65, 0.02, seed=2))
    starts, ends = np.array([[arc.start, arc.end] for arc in plan.arcs]).T
    assert len(plan.arcs) >= 2
    np.testing.assert_array_equal(ends, [*starts[1:], starts[0] + FULL_TURN])
    np.testing.assert_allclose(plan.envelope.radius(rim_directions(plan.crossings)), 12.7, atol=1e-11)
    for arc in plan.arcs:
        radius = plan.envelope.radius(rim_directions(np.linspace(arc.start, arc.end, 50)[1:-1]))
        assert ((radius > 12.7) == (arc.relation == "overhang")).all()


def test_surfaces_that_cross_are_refused_with_the_place():
    outer = sphere(2.45)
    weights = outer.weights_mm.copy()
    weights[0] = -1.8  # the first centre is the nearest to the axis
    with pytest.raises(InputError, match=r"wall = -0\.\d+ mm in the direction \(0\.\d+"):
        plan_of(sphere(0.8), SrbfSurface(outer.basis, weights, 2.45))
