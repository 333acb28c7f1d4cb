"""A medium that several faces bound: each is measured on its own part of the chart, up to the crease."""

from dataclasses import replace

import numpy as np
import pytest
from known_shapes import exported, sphere
from scenes import small_spec

from lensforge.cad.boundary import boundaries
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.scene.body import Body, Face
from lensforge.shop.ball_clearance import wall_retreat_mm
from lensforge.shop.face_check import face_result, milled_face
from lensforge.shop.face_samples import AirSide, OpticalFace, all_points, sample_face

# The cap and the side of a cavity, two spheres that meet in a circle at z = 0.51: 4 - (z + 0.5)^2 = 1.8^2 - z^2.
CAP = sphere(2.0, (0.0, 0.0, -0.5))
SIDE = sphere(1.8)
MET_MM = 0.51


@pytest.fixture(scope="module")
def cavity() -> dict[str, OpticalFace]:
    """Both faces as they are exported, each beside the other."""
    body = Body(
        (Face("cap", CAP, CAVITY, BODY), Face("side", SIDE, CAVITY, BODY), Face("exit", sphere(3.0), BODY, OUTSIDE))
    )
    faces = boundaries(body)[0].faces
    alone = {face.name: replace(exported(face.shape, AirSide.INSIDE), domain=face.domain) for face in faces}
    cap, side = alone.values()
    return {"cap": replace(cap, beside=(side,)), "side": replace(side, beside=(cap,))}


def test_each_face_is_measured_up_to_the_crease(cavity) -> None:
    for name, radius, height, steepest in (("cap", 2.0, 1.5 - MET_MM, MET_MM + 0.5), ("side", 1.8, MET_MM, 0.0)):
        result = face_result(milled_face(cavity[name], 1.0, 81), small_spec())
        assert result.area_mm2 == pytest.approx(2.0 * np.pi * radius * height, rel=1e-8), "a zone of a sphere"
        assert (
            result.best_fit_sphere.radius_mm == pytest.approx(radius, abs=1e-6) and result.best_fit_sphere.pv_mm < 1e-6
        )
        assert result.curvature.smallest_concave_radius_mm == pytest.approx(radius, abs=1e-4)
        assert result.draft_deg.min == pytest.approx(np.degrees(np.arcsin(steepest / radius)), abs=1e-3)
        heights = result.xyz[..., 2][np.isfinite(result.sag_mm)]
        low, high = (MET_MM, 1.5) if name == "cap" else (0.0, MET_MM)
        assert low - 1e-6 < heights.min() < low + 0.06 and high - 0.06 < heights.max() < high + 1e-6


def test_no_ball_reaches_the_crease_of_a_cavity_and_no_other_place_is_beyond_it(cavity) -> None:
    """A ball that rests on both spheres touches each where their centres are its radius nearer: on the axis side."""
    ball = 0.5
    for name, radius, centre in (("cap", 2.0, -0.5), ("side", 1.8, 0.0)):
        face = milled_face(cavity[name], ball, 101)
        assert 0.0 < face.samples.fraction(face.reached) < 1.0
        # Its centre lies on a sphere of 1.5 mm about (0, -0.5) and one of 1.3 mm about the origin.
        up = (1.5**2 - 1.3**2 - 0.25) / 1.0
        across = np.sqrt(1.3**2 - up**2)
        contact = np.array([across, up - centre]) * radius / (radius - ball) + [0.0, centre]
        height = face.samples.points[:, 2]
        reached = height > contact[1] + 0.05 if name == "cap" else height < contact[1] - 0.05
        lost = (height < contact[1] - 0.05) if name == "cap" else height > contact[1] + 0.05
        assert face.reached[reached].all() and not face.reached[lost].any()
        assert reached.any() and lost.any()


def test_obstacles_and_rim_are_those_of_the_whole_medium(cavity) -> None:
    points = all_points(cavity["cap"], 41)
    both = [sample_face(face, 41).points for face in cavity.values()]
    assert len(points) == sum(map(len, both)) and points[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    turn = np.array([[1.0, 0.0], [0.0, -1.0]])
    for face in cavity.values():
        assert face.rim_mm(turn) == pytest.approx([1.8, 1.8], abs=1e-6)
    assert (wall_retreat_mm(sample_face(cavity["cap"], 41), 0.3, 5.0) == 0.0).all(), "a ball on the cap is above z = 0"
