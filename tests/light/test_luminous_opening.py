"""The luminous opening of lenses of every kind: their exit as it is seen along the axis, by closed forms."""

from math import cos, radians, sin, sqrt

import numpy as np
import pytest
from chains import REACH
from presets import FEW
from scenes import hemisphere_directions, random_surface, small_spec, sphere
from tir_lenses import spot

import lensforge as lf
from lensforge.light.luminous_opening import luminous_opening
from lensforge.optics.pose import ALONG_Z
from lensforge.spec import parse_spec
from lensforge.spec.lamp_places import Lamp
from lensforge.spec.lamps_section import ALONE, Lamps
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace

DOME = lf.Lens.double(sphere(3.0), sphere(6.0), small_spec(), seed=0, accuracy="draft")
# where the wall of the collimator meets its exit
RIM_MM = 5.0 + 0.6 * 8.0
EXIT_MM = 8.0
COLLIMATOR = lf.Lens(
    {
        "cap": sphere(4.0),
        "side": ConeFace(REACH, 3.2, 0.02),
        "wall": ConeFace(REACH, 5.0, 0.6),
        "exit": PlaneFace(REACH, EXIT_MM),
    },
    spot(),
    0,
    FEW,
)


def _sizes(lens: lf.Lens, lamps: Lamps = ALONE) -> list[float]:
    opening = luminous_opening(lens, lamps)
    return [opening.length_mm, opening.width_mm, *opening.heights_mm[:1]]


def test_a_dome_is_a_cylinder_as_high_as_it_rises() -> None:
    assert luminous_opening(DOME, ALONE).shape == "vertical cylinder"
    assert _sizes(DOME) == pytest.approx([12.0, 12.0, 6.0], rel=1e-9)


def test_a_collimator_is_the_disc_of_its_exit_whatever_its_distance_from_the_led() -> None:
    assert luminous_opening(COLLIMATOR, ALONE).shape == "circle"
    assert _sizes(COLLIMATOR) == pytest.approx([2.0 * RIM_MM, 2.0 * RIM_MM, 0.0], rel=1e-9)
    flanged = lf.Lens(
        {**COLLIMATOR.surfaces, "flange": ConeFace(1.1 * REACH, 9.0)},
        spot(flange={"diameter_mm": 24.0, "thickness_mm": 1.0}),
        0,
        FEW,
    )
    assert _sizes(flanged) == pytest.approx([18.0, 18.0, 0.0], rel=1e-9), "no light leaves by the flange"


def test_an_exit_that_rises_has_the_height_of_its_middle_above_its_rim() -> None:
    bowed = lf.Lens({**COLLIMATOR.surfaces, "exit": sphere(10.0)}, spot(), 0, FEW)
    z = (-3.0 + sqrt(9.0 + 1.36 * 75.0)) / 1.36  # (5 + 0.6 z)^2 + z^2 = 100
    assert _sizes(bowed) == pytest.approx([10.0 + 1.2 * z, 10.0 + 1.2 * z, 10.0 - z], rel=1e-9)


def test_a_reflector_is_its_mouth() -> None:
    spec = parse_spec({**_BEAM, "lens": {"kind": "reflector"}}, "beam")
    faces = {"cup": ConicFace(REACH, 5.0, 1.0), "back": ConicFace(REACH, 6.0, 1.0), "mouth": PlaneFace(REACH, 6.0)}
    across = 2.0 * sqrt(5.0**2 + 2.0 * 5.0 * 6.0)  # r^2 = p^2 + 2 p z of the paraboloid about its focus
    assert _sizes(lf.Lens(faces, spec, 0, FEW)) == pytest.approx([across, across, 0.0], rel=1e-9)


_BEAM = {
    "source": {"kind": "square", "side_mm": 1.0},
    "constraints": {"max_radius_mm": 12.0},
    "target": {"kind": "disc", "diameter_deg": 20.0, "half_angle_deg": 30.0},
}


def test_several_lamps_have_the_box_of_all_and_each_is_seen_as_it_leans() -> None:
    level = Lamps.level([(-15.0, 0.0), (15.0, 0.0)])
    assert luminous_opening(DOME, level).shape == "box"
    assert _sizes(DOME, level) == pytest.approx([42.0, 12.0, 6.0], rel=1e-9)
    assert _sizes(COLLIMATOR, level) == pytest.approx([30.0 + 2.0 * RIM_MM, 2.0 * RIM_MM, 0.0], rel=1e-9)
    lean = radians(30.0)
    lamps = Lamps((Lamp((0.0, 0.0, 100.0), (sin(lean), 0.0, cos(lean))),))
    across = 2.0 * RIM_MM
    assert _sizes(COLLIMATOR, lamps) == pytest.approx([across * cos(lean), across, across * sin(lean)], rel=1e-9)
    high = Lamps((Lamp((0.0, 0.0, 0.0), ALONG_Z), Lamp((0.0, 40.0, 7.0), ALONG_Z)))
    assert _sizes(COLLIMATOR, high) == pytest.approx([across, 40.0 + across, 7.0], rel=1e-9)


@pytest.mark.parametrize("turned", [(0.0, 90.0), (90.0, 0.0), (0.0, 40.0)])
def test_each_of_two_oblong_lenses_is_as_wide_as_it_is_turned(turned: tuple[float, float]) -> None:
    """The box of the points of both, which lie 30 mm apart."""
    outer = random_surface(3, 6.0, roughness=0.3)
    lens = lf.Lens.double(sphere(2.0), outer, small_spec(), 0, FEW)
    lamps = Lamps(tuple(Lamp((x, 0.0, 0.0), ALONG_Z, turn) for x, turn in zip((-15.0, 15.0), turned, strict=True)))
    units = hemisphere_directions(400_000)
    points = outer.radius(units)[:, None] * units
    low = []
    high = []
    for x, turn in zip((-15.0, 15.0), turned, strict=True):
        across = points[:, :1] * [cos(radians(turn)), sin(radians(turn))]
        across = across + points[:, 1:2] * [-sin(radians(turn)), cos(radians(turn))] + [x, 0.0]
        low.append(across.min(axis=0))
        high.append(across.max(axis=0))
    wide = np.max(high, axis=0) - np.min(low, axis=0)
    assert _sizes(lens, lamps)[:2] == pytest.approx(wide, rel=2e-3)
    alone = np.ptp(points[:, :2], axis=0)
    assert abs(alone[0] - alone[1]) > 0.05 * alone[0], "oblong, so that the turn matters"


def test_a_body_behind_the_lens_is_what_one_sees() -> None:
    cover = {"name": "cover", "refractive_index": 1.5, "inner": {"fixed": _ball(9.0)}, "outer": {"fixed": _ball(10.0)}}
    covered = lf.Lens.double(sphere(3.0), sphere(6.0), small_spec(bodies=[cover]), 0, FEW)
    assert _sizes(covered) == pytest.approx([20.0, 20.0, 10.0], rel=1e-3)


def _ball(radius_mm: float) -> dict[str, object]:
    return {"kind": "sphere", "radius_mm": radius_mm, "centre_z_mm": 0.0}


@pytest.mark.parametrize(
    ("lens", "sizes"), [(COLLIMATOR, [2.0 * RIM_MM, 2.0 * RIM_MM, 0.0]), (DOME, [12.0, 12.0, 6.0])]
)
def test_the_files_state_it(lens, sizes, tmp_path) -> None:
    photometry = lf.photometry(lens, rays=2**10)
    for suffix, content in photometry.products().items():
        (tmp_path / f"lens{suffix}").write_bytes(content)
    for suffix in (".ies", ".ldt", ".iesxml"):
        read = lf.rays(tmp_path / f"lens{suffix}")
        np.testing.assert_allclose(read.opening_mm, sizes, rtol=1e-5)
        assert read.opening_shape == ("circle" if sizes[2] == 0.0 else "vertical cylinder")
