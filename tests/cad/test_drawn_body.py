"""The body of a linear lens: its files read back, against the section of its profiles times its length."""

import numpy as np
import pytest
from scenes import small_spec
from scipy.spatial import cKDTree

import lensforge as lf
from lensforge.cad.section import body_outlines
from lensforge.cad.step import parse_step
from lensforge.cad.wall import thinnest_of
from lensforge.errors import InputError
from lensforge.proof.step_body import StepBody
from lensforge.surfaces.drawn_profile import DrawnFace, round_profile

LENGTH_MM = 137.0
INNER = DrawnFace(12.0, (0.34, 0.33, 0.335, 0.32, 0.33, 0.325, 0.315, 0.33, 0.34))
OUTER = DrawnFace(12.0, (0.16, 0.162, 0.159, 0.158, 0.157, 0.155, 0.157, 0.16, 0.162))
LENS = {"kind": "extruded", "length_mm": LENGTH_MM, "profile": 9, "symmetry": "none"}


def lens_of(inner: DrawnFace, outer: DrawnFace) -> lf.Lens:
    spec = small_spec(lens=LENS, optimise__steps_per_level=[1], base={"kind": "none"})
    return lf.Lens({"inner": inner, "outer": outer}, spec, 0, "draft")


@pytest.fixture(scope="module")
def part() -> lf.Part:
    return lf.build(lens_of(INNER, OUTER))


def area_mm2(faces: tuple[DrawnFace, DrawnFace]) -> float:
    """Area between two profiles, by the radius over the angle."""
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 20001)
    inner, outer = (np.sum(face.points(angles) ** 2, axis=1) for face in faces)
    return float(np.trapezoid(0.5 * (outer - inner), angles))


def test_its_volume_is_the_area_of_the_section_times_its_length(part: lf.Part) -> None:
    assert part.volume_mm3 == pytest.approx(LENGTH_MM * area_mm2((INNER, OUTER)), rel=1e-7)
    assert part.volume_mesh_mm3 == pytest.approx(part.volume_mm3, rel=1e-4)
    assert part.bounds_mm[0][1] == -0.5 * LENGTH_MM and part.bounds_mm[1][1] == 0.5 * LENGTH_MM


def test_its_faces_are_surfaces_of_linear_extrusion_and_have_names(part: lf.Part) -> None:
    assert part.step.count(b"SURFACE_OF_LINEAR_EXTRUSION") == 2
    assert part.faces.names == ("END_1", "END_2", "OPTICAL_INNER", "OPTICAL_OUTER", "RIM_1", "RIM_2")
    assert part.step_valid and part.watertight and part.genus == 0
    assert part.form_error_nm.max < 50.0 and part.normal_error_mrad.max < 0.2
    assert parse_step(part.step).valid


def test_a_body_is_as_long_wide_and_high_as_its_file(part: lf.Part) -> None:
    size = StepBody(part.step).size()
    (x0, y0, z0), (x1, y1, z1) = size.bounds_mm
    widest = OUTER.points(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 2001))
    assert (y0, y1) == pytest.approx((-0.5 * LENGTH_MM, 0.5 * LENGTH_MM))
    assert (x0, x1) == pytest.approx((widest[:, 0].min(), widest[:, 0].max()), abs=1e-4)
    assert (z0, z1) == pytest.approx((0.0, widest[:, 1].max()), abs=1e-4)


def test_a_closed_form_a_half_pipe() -> None:
    part = lf.build(lens_of(round_profile(3.0, 7.0, 9), round_profile(6.0, 7.0, 9)))
    assert part.volume_mm3 == pytest.approx(0.5 * np.pi * (36.0 - 9.0) * LENGTH_MM, rel=1e-8)
    assert part.area_mm2 == pytest.approx(np.pi * 9.0 * LENGTH_MM + 6.0 * LENGTH_MM + np.pi * 27.0, rel=1e-7)


def test_its_wall_is_that_of_the_section() -> None:
    """Far along y, beyond the reach of its radius from the LED, the two faces bend towards each other."""
    lens = lens_of(INNER, OUTER)
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 4001)
    inner, outer = (face.points(angles) for face in (INNER, OUTER))
    assert thinnest_of(lens).thickness_mm == pytest.approx(cKDTree(outer).query(inner)[0].min(), abs=1e-5)
    half_pipe = lens_of(round_profile(3.0, 7.0, 9), round_profile(6.5, 7.0, 9))
    assert thinnest_of(half_pipe).thickness_mm == pytest.approx(3.5, abs=1e-6)


def test_profiles_that_meet_have_no_body() -> None:
    with pytest.raises(InputError, match="the outer profile must lie outside the inner one"):
        lf.build(lens_of(INNER, round_profile(3.05, 7.0, 9)))


def test_its_sections_are_its_profiles_and_along_y_a_wall_from_end_to_end() -> None:
    lens = lens_of(INNER, OUTER)
    (across,) = body_outlines(lens, 0.0)
    x, z = across.T
    assert abs(0.5 * np.sum(x * np.roll(z, -1) - z * np.roll(x, -1))) == pytest.approx(
        area_mm2((INNER, OUTER)), rel=1e-4
    )
    (along,) = body_outlines(lens, 90.0)
    low, high = (float(face.points(np.zeros(1))[0, 1]) for face in (INNER, OUTER))
    y, z = along.T
    assert abs(0.5 * np.sum(y * np.roll(z, -1) - z * np.roll(y, -1))) == pytest.approx(
        (high - low) * LENGTH_MM, rel=1e-2
    )
    assert np.abs(y).max() == pytest.approx(0.5 * LENGTH_MM)
