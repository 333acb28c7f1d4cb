"""What is drawn of a lens against closed forms: spheres about and beside the origin, and a ball in a corner."""

from typing import Any

import numpy as np
import pytest
from scenes import small_spec, sphere

import lensforge as lf
from lensforge.addons.studio.lens_view import Side, drawn
from lensforge.scene.body import Body

OUTER_MM, INNER_MM = 10.0, 4.0


def sides(outer: Any = None, inner: Any = None) -> tuple[Side, Side]:
    body = Body.of({"inner": inner or sphere(INNER_MM), "outer": outer or sphere(OUTER_MM)})
    return Side(body.envelope, 1), Side(body.cavity, -1)


def test_figures_of_two_spheres_are_their_closed_forms() -> None:
    outer, inner = sides()
    polar = np.degrees(np.arccos(outer.net[..., 2] / OUTER_MM))
    assert outer.figure("sag", inner) == pytest.approx(OUTER_MM * np.cos(np.radians(polar)), abs=1e-9)
    assert outer.figure("slope", inner) == pytest.approx(polar, abs=0.3)
    assert outer.figure("curvature", inner) == pytest.approx(1.0 / OUTER_MM, rel=0.01)
    assert inner.figure("curvature", outer)[:-2] == pytest.approx(-1.0 / INNER_MM, rel=0.01)
    assert outer.figure("wall", inner) == pytest.approx(OUTER_MM - INNER_MM, rel=1e-3)
    assert (outer.figure("ball", inner) == -1.0).all(), "any ball touches a sphere from outside"
    assert inner.figure("ball", outer)[1:-2] == pytest.approx(INNER_MM, rel=0.05)


def test_normals_point_into_the_air() -> None:
    outer, inner = sides()
    assert np.sum(outer.normals * outer.points, axis=1) == pytest.approx(OUTER_MM, rel=2e-3)
    assert np.sum(inner.normals * inner.points, axis=1) == pytest.approx(-INNER_MM, rel=2e-3)


def test_rays_and_section_are_those_of_the_lens() -> None:
    lens = lf.Lens.double(sphere(3.0), sphere(6.0), small_spec(), 0, "draft")
    arrays = drawn(lens, "sag", whole=True)
    assert arrays["rays"].shape[0] == len(arrays["fates"])
    assert (arrays["fates"] == 0.0).mean() > 0.9, "concentric spheres let nearly all light out"
    steep = arrays["fan"][10]  # straight on along the axis
    assert steep[:, 0] == pytest.approx(0.0, abs=1e-9) and {3.0, 6.0} <= set(np.round(steep[:, 1], 6))
    radius = np.hypot(*drawn(lens, "sag")["outline0"].T)
    assert set(np.round(radius, 6)) == {3.0, 6.0}
