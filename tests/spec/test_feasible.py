"""Limits that no lens keeps are refused with the spec: every bound against a shape that attains it."""

import numpy as np
import pytest
from nightly import first_by_day
from scenes import small_spec, sphere

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.search.feasibility import measure_constraints
from lensforge.spec import BaseSection
from lensforge.spec.feasible import require_base_around_cavity, smallest_cavity_mm
from lensforge.spec.fixed_surface import FixedAsphere, FixedSphere

POLAR = np.linspace(0.0, 0.5 * np.pi, 2001)
LENS = {"levels": [9, 25], "outer": {"offset_mm": 6.0}}
DOME = {
    "levels": [9, 25],
    "inner": {"offset_mm": 2.0},
    "outer": {"fixed": {"kind": "sphere", "radius_mm": 4.0, "centre_z_mm": -1}},
}


def inner(radius_mm: float, centre_z_mm: float = 0.0) -> dict[str, object]:
    return LENS | {"inner": {"fixed": {"kind": "sphere", "radius_mm": radius_mm, "centre_z_mm": centre_z_mm}}}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"constraints__cavity_height_mm": 8.0},
            r"cavity_height_mm = 8 and min_thickness_mm = 1 do not fit.*max_radius_mm",
        ),
        ({"constraints__cavity_radius_mm": 6.5}, r"cavity_radius_mm = 6.5 and .* = 7: make it at least 7\.507"),
        ({"constraints__max_radius_mm": 1.9}, r"cavity_radius_mm = 1 and min_thickness_mm = 1 .*at least 2\.002"),
        ({"constraints__min_thickness_mm": 60.0}, r"min_thickness_mm = 60 do not fit into max_radius_mm = 7"),
        (
            {"lens": inner(3.0), "constraints__min_thickness_mm": 4.5},
            r"inner.fixed reaches 7\.5 mm .*max_radius_mm = 7: at least 7\.5;",
        ),
        (
            {"lens": inner(3.0), "lens__inner__draft_deg": 1.0},
            r"lens.inner.fixed has a draft of 0 deg .*lens.inner.draft_deg = 1;",
        ),
        ({"lens": inner(3.0, -1.0), "lens__inner__draft_deg": 20.0}, r"has a draft of 19\.5 deg"),
        ({"lens": inner(3.0), "lens__inner__concave_radius_mm": 3.1}, r"has a concave radius of 3 mm"),
        (
            {"lens": inner(3.0), "constraints__max_height_mm": 3.9},
            r"inner.fixed reaches 4 mm above z = 0 under a wall of .* = 1, constraints.max_height_mm = 3.9",
        ),
        ({"lens": DOME, "constraints__max_height_mm": 2.9}, r"outer.fixed reaches 3 mm .* at least 3;"),
        ({"constraints__keep_out_margin_mm": 0.2}, r"keep_out_margin_mm = 0.2 goes with keep_out"),
        (
            {"lens": DOME, "constraints__min_thickness_mm": 2.6},
            r"outer.fixed leaves no room .* they reach 3\.1 .* is at 3;",
        ),
    ],
)
def test_limits_that_no_lens_keeps_are_named_in_one_line(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        small_spec(**changes)
    assert "\n" not in str(refusal.value) and len(str(refusal.value)) < 400


def test_the_least_lens_that_is_accepted_exists() -> None:
    """Two hemispheres, each a margin of the search beyond its limit, keep all three limits by that margin."""
    rng = np.random.default_rng(4)
    for height, radius, wall in rng.uniform(0.1, 5.0, (6, 3)):
        limits = {"cavity_height_mm": height, "cavity_radius_mm": radius, "min_thickness_mm": wall}
        least = (max(height, radius) + wall) / (1.0 - 9e-4)
        start = {"lens__inner__offset_mm": 0.5 * least, "lens__outer__offset_mm": 0.9 * least}
        spec = small_spec(
            constraints=limits | {"max_radius_mm": least * (1.0 + 1e-9)}, target__distance_mm=1e3, **start
        )
        margin = spec.constraints.margin_mm
        spheres = sphere(max(height, radius) + margin), sphere(max(height, radius) + wall + 2.0 * margin)
        margins = measure_constraints(Lens.double(*spheres, spec, 0, "draft"), directions=2000)
        assert margins.wall_margin_mm >= margin * 0.999 and margins.radius_margin_mm >= margin * 0.999
        assert margins.cavity_clearance_mm >= 0.0
        with pytest.raises(InputError, match="do not fit into max_radius_mm"):
            small_spec(constraints=limits | {"max_radius_mm": least * (1.0 - 1e-6)}, target__distance_mm=1e3, **start)


@pytest.mark.parametrize(
    ("height", "radius", "draft"), first_by_day(1, [(3.0, 1.0, 10.0), (5.0, 2.0, 25.0), (1.0, 4.0, 5.0), (2.0, 1.0, 0)])
)
def test_the_smallest_cavity_with_a_draft_is_the_paraboloid_with_the_steepest_allowed_flank(
    height: float, radius: float, draft: float
) -> None:
    """By brute force: of all heights of the paraboloid, each falls by cot(draft) per mm at most."""
    limits = {"cavity_height_mm": height, "cavity_radius_mm": radius, "min_thickness_mm": 0.1, "max_radius_mm": 20.0}
    spec = small_spec(constraints=limits, lens__inner__draft_deg=draft or None)
    cavity_mm, polar = smallest_cavity_mm(spec.lens, spec.constraints)[::4], POLAR[::4]
    r, z = cavity_mm * np.sin(polar), cavity_mm * np.cos(polar)
    source = np.linspace(0.0, radius, 20_001)
    paraboloid = height * (1.0 - (source / radius) ** 2)
    steepest = 1.0 / np.tan(np.deg2rad(draft)) if draft else np.inf
    with np.errstate(invalid="ignore"):
        fall = np.where(r[:, None] == source, 0.0, steepest * np.abs(r[:, None] - source))
    raised = (paraboloid - fall).max(axis=1) if draft else np.interp(r, source, paraboloid)
    assert z == pytest.approx(np.maximum(raised, 0.0), abs=2e-4 * (steepest if draft else 1.0))


def test_shape_of_fixed_surfaces_in_closed_form() -> None:
    ball = FixedSphere(radius_mm=4.0, centre_z_mm=-1.0)
    assert ball.shape.curvatures_per_mm == pytest.approx((0.25, 0.25), rel=1e-6)
    assert ball.shape.least_draft_deg == pytest.approx(np.degrees(np.arcsin(0.25)), abs=1e-9)
    paraboloid = FixedAsphere(vertex_z_mm=3.0, radius_mm=-2.0, conic_constant=-1.0)  # z = 3 - r^2 / 4
    rim_slope = np.sqrt(12.0) / 2.0
    least, most = paraboloid.shape.curvatures_per_mm
    assert most == pytest.approx(0.5, rel=1e-5)
    assert least == pytest.approx(0.5 / (1.0 + rim_slope**2) ** 1.5, rel=1e-3)
    assert paraboloid.shape.least_draft_deg == pytest.approx(np.degrees(np.arctan(1.0 / rim_slope)), abs=1e-6)


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ({"diameter_mm": 1.5}, r"base.diameter_mm = 1.5: the cavity .* radius of 1 mm .* above 2,"),
        ({"kind": "square", "side_mm": 1.5}, r"base.side_mm = 1.5: "),
        ({"flat_mm": 0.9}, r"base.flat_mm = 0.9: .* above 1,"),
        ({"pocket_diameter_mm": 1.8}, r"base.pocket_diameter_mm = 1.8: "),
    ],
)
def test_a_base_inside_the_cavity_is_refused_for_a_part(base: dict[str, object], message: str) -> None:
    spec = small_spec()
    with pytest.raises(InputError, match=message):
        require_base_around_cavity(spec.lens, spec.constraints, BaseSection(**base))
    for kind in ("none", "cylinder"):
        require_base_around_cavity(spec.lens, spec.constraints, BaseSection(kind=kind, diameter_mm=16.0))


def test_a_base_is_wider_than_the_widest_meridian_of_a_cavity_that_is_not_round() -> None:
    """Paraboloids of 3 mm: half axes of sqrt(2 · 3 · 1.5) and sqrt(2 · 3 · 3) mm."""
    oval = {"kind": "biconic", "vertex_z_mm": 3.0, "radius_x_mm": -1.5, "radius_y_mm": -3.0}
    spec = small_spec(lens=LENS | {"inner": {"fixed": oval | {"conic_x": -1.0, "conic_y": -1.0}}})
    with pytest.raises(InputError, match=r"lens\.inner\.fixed opens to a radius of 4\.243 mm .* above 8\.4\d+,"):
        require_base_around_cavity(spec.lens, spec.constraints, BaseSection(diameter_mm=8.4))
    require_base_around_cavity(spec.lens, spec.constraints, BaseSection(diameter_mm=8.6))
