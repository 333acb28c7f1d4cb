"""Lamps of a closed form on areas and roads: zones, ratings, distribution types and classes of glare."""

import numpy as np
import pytest
from nightly import first_by_day

from lensforge.light.angular_grid import AngularGrid
from lensforge.light.area_lamp import AreaLamp, glare_intensities
from lensforge.light.luminaire_classes import BugRating, LampLight, ZoneLumens, distribution_type, zone_flux
from lensforge.results import Metric
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec.light_limits import PhotometrySection

GRID = AngularGrid(144, np.linspace(0.0, 90.0, 181))


def _lamp(intensity, noise: float = 0.0, street_deg: float = 90.0) -> LampLight:
    """Lamp of ``intensity`` (lateral angle, gamma; rad), with relative noise at each node of each of 16 samples."""
    lateral, gamma = np.meshgrid(np.deg2rad(GRID.c_deg - street_deg), np.deg2rad(GRID.gamma_deg), indexing="ij")
    values = intensity(lateral, gamma)
    random = np.random.default_rng(0).normal(size=(16, *values.shape))
    return LampLight(GRID, values * (1.0 + noise * random), street_deg)


def _lambertian(axis_cd: float, **options: float) -> LampLight:
    return _lamp(lambda lateral, gamma: axis_cd * np.cos(gamma), **options)


def _lobes(at_lateral_deg: float, at_gamma_deg: float, width_deg: float = 12.0, back: float = 0.0) -> LampLight:
    """Two lobes along the road, to both sides of the street's direction."""

    def intensity(lateral, gamma):
        total = back * 1000.0 * np.cos(gamma)
        for side in (-1.0, 1.0):
            turn = (
                np.cos(lateral - side * np.deg2rad(at_lateral_deg)) * np.sin(gamma) * np.sin(np.deg2rad(at_gamma_deg))
            )
            away = np.arccos(np.clip(turn + np.cos(gamma) * np.cos(np.deg2rad(at_gamma_deg)), -1.0, 1.0))
            total = total + 1000.0 * np.exp(-0.5 * (away / np.deg2rad(width_deg)) ** 2)
        return total

    return _lamp(intensity)


def _lambertian_rays(count: int = 2**16) -> RayBundle:
    return SquareEmitter(1.0).sample(count, 3)


@pytest.mark.parametrize("street_deg", [0.0, 90.0, 37.3, -200.0])
def test_zones_of_a_lambertian_lamp(street_deg: float) -> None:
    """Half of sin^2 of the upper angle less that of the lower, in front and at the back."""
    flux = zone_flux(_lambertian_rays(), street_deg, "none")
    edges = np.sin(np.deg2rad([0.0, 30.0, 60.0, 80.0, 90.0])) ** 2
    np.testing.assert_allclose(flux, np.tile(0.5 * np.diff(edges), (2, 1)), atol=2e-3)
    zones = ZoneLumens.of(1000.0 * np.stack([flux, 1.02 * flux]))
    assert zones.back_mid.value == pytest.approx(1010.0 * flux[1, 1])
    assert zones.back_mid.standard_error == pytest.approx(10.0 * flux[1, 1])
    assert zones.up_low.value == zones.up_high.value == 0.0


def test_an_edge_of_light_between_two_zones_is_theirs_by_the_ray() -> None:
    """A cone of even intensity to 61.7 degrees about the axis, with light to +y alone: no table's step blurs it."""
    rays = _lambertian_rays(2**18)
    end = np.deg2rad(61.7)
    z = 1.0 - (1.0 - np.cos(end)) * (1.0 - rays.directions[:, 2] ** 2)  # even over solid angle
    side = np.sqrt((1.0 - z**2) / (1.0 - rays.directions[:, 2] ** 2))
    x, y = (side * rays.directions[:, axis] for axis in (0, 1))
    cone = RayBundle(rays.origins, np.column_stack([x, np.abs(y), z]), rays.flux)
    low = 1.0 - np.cos(np.deg2rad(30.0))
    mid = np.cos(np.deg2rad(30.0)) - 0.5
    expected = np.array([low, mid, 0.5 - np.cos(end), 0.0]) / (1.0 - np.cos(end))
    np.testing.assert_allclose(zone_flux(cone, 90.0, "none"), [expected, np.zeros(4)], atol=1e-4)
    np.testing.assert_allclose(zone_flux(cone, -90.0, "none"), [np.zeros(4), expected], atol=1e-4)
    np.testing.assert_allclose(zone_flux(cone, 90.0, "mirror_y"), [0.5 * expected] * 2, atol=1e-4)


def _zones(**lumens: float) -> ZoneLumens:
    return ZoneLumens(
        **{name: Metric(value=lumens.get(name, 0.0), unit="lm", standard_error=1.0) for name in ZoneLumens.model_fields}
    )


def test_the_worst_zone_of_each_kind_makes_the_rating() -> None:
    lumens = {"back_mid": 5100.0, "forward_high": 5100.0, "up_low": 55.0, "up_high": -10.0}
    assert str(BugRating.of(_zones(**lumens), symmetric=False)) == "B4 U3 G3"


# ANSI/IES TM-15-11, addendum A, tables, typed a second time: most lumens of each zone for ratings 0 to 4.
_TM15 = [
    ("backlight", "back_low", False, (110, 500, 1000, 2500, 5000)),
    ("backlight", "back_mid", False, (220, 1000, 2500, 5000, 8500)),
    ("backlight", "back_high", False, (110, 500, 1000, 2500, 5000)),
    ("uplight", "up_low", False, (0, 10, 50, 500, 1000)),
    ("uplight", "up_high", False, (0, 10, 50, 500, 1000)),
    ("glare", "forward_very_high", False, (10, 100, 225, 500, 750)),
    ("glare", "forward_very_high", True, (10, 100, 225, 500, 750)),
    ("glare", "back_very_high", False, (10, 100, 225, 500, 750)),
    ("glare", "back_very_high", True, (10, 100, 225, 500, 750)),
    ("glare", "forward_high", False, (660, 1800, 5000, 7500, 12000)),
    ("glare", "forward_high", True, (660, 1800, 5000, 7500, 12000)),
    ("glare", "back_high", False, (110, 500, 1000, 2500, 5000)),
    ("glare", "back_high", True, (660, 1800, 5000, 7500, 12000)),
]


@pytest.mark.parametrize(("rating", "zone", "symmetric", "most"), _TM15)
def test_every_bound_of_tm_15_is_seen_from_both_sides(
    rating: str, zone: str, symmetric: bool, most: tuple[float, ...]
) -> None:
    for number, lumens in enumerate(most):
        for given, wanted in ((lumens, number), (lumens + 0.5, number + 1)):
            assert getattr(BugRating.of(_zones(**{zone: given}), symmetric=symmetric), rating) == wanted, given


@pytest.mark.parametrize(
    ("lateral", "gamma", "wanted"),
    first_by_day(
        2,
        [
            (90.0, 60.0, "type I short"),  # along: tan 60 = 1.73 heights, none across
            (75.0, 70.0, "type II medium"),  # 2.65 along, 0.71 across and the half width of the lobe
            (55.0, 68.0, "type III short"),
            (25.0, 70.0, "type IV short"),
        ],
    ),
)
def test_types_of_lamps_with_two_lobes(lateral: float, gamma: float, wanted: str) -> None:
    distribution = distribution_type(_lobes(lateral, gamma, width_deg=5.0))
    assert distribution.along_mh == pytest.approx(np.tan(np.deg2rad(gamma)) * np.sin(np.deg2rad(lateral)), rel=0.02)
    assert str(distribution) == wanted


def test_a_lamp_that_is_the_same_all_around_is_type_five() -> None:
    distribution = distribution_type(_lambertian(100.0))
    assert str(distribution) == "type V very short"
    assert distribution.roundness.value == pytest.approx(1.0)
    ring = _lamp(lambda lateral, gamma: np.exp(-(((gamma - 1.2) / 0.1) ** 2)))
    assert str(distribution_type(ring)) == "type V medium"


def test_the_reach_of_half_the_light_is_that_of_the_lobe() -> None:
    """A lobe of Gaussian shape straight towards the street: half of it is 1.1774 standard deviations out."""
    distribution = distribution_type(
        _lamp(lambda lateral, gamma: np.exp(-0.5 * ((gamma - 0.8) / 0.1) ** 2) * (np.cos(lateral) > 0.9))
    )
    assert distribution.street_mh.value == pytest.approx(np.tan(0.8 + 0.1 * np.sqrt(2.0 * np.log(2.0))), abs=0.02)
    assert distribution.house_mh.value == 0.0


# EN 13201-2:2015, table A.1, typed a second time: most cd/klm from 70 and from 80 degrees; G*4 to G*6 have the same 80.
@pytest.mark.parametrize(
    ("at_70", "at_80", "wanted"),
    [
        (349.0, 99.0, "G*6"), (351.0, 99.0, "G*4"), (499.0, 99.0, "G*4"), (501.0, 99.0, "G*3"), (9e3, 99.0, "G*3"),
        (349.0, 101.0, "G*2"), (9e3, 149.0, "G*2"), (9e3, 151.0, "G*1"), (349.0, 199.0, "G*1"), (9e3, 199.0, "G*1"),
        (9e3, 201.0, "none"), (349.0, 201.0, "none"),
    ],
)  # fmt: skip
def test_glare_classes_ask_for_both_angles(at_70: float, at_80: float, wanted: str) -> None:
    lamp = _lamp(lambda lateral, gamma: np.where(gamma < np.deg2rad(79.9), at_70, at_80) + 0.0 * lateral)
    assert glare_intensities(lamp, 1000.0).glare_class == wanted


def test_a_lamp_of_many_lenses_has_their_light() -> None:
    lamp = _lambertian(10.0)
    section = PhotometrySection(use="area", lenses=48)
    flux = Metric(value=10.0 * np.pi, unit="lm", standard_error=0.1)
    zones_lm = np.full((16, 2, 4), 10.0 * np.pi / 8.0)
    area_lamp = AreaLamp.of(section, lamp, flux, zones_lm)
    assert area_lamp is not None
    assert area_lamp.lumens.value == pytest.approx(480.0 * np.pi)
    assert area_lamp.lumens.standard_error == pytest.approx(4.8)
    assert area_lamp.glare.above_70.value == pytest.approx(1000.0 / np.pi * np.cos(np.deg2rad(70.0))), (
        "of its own lumens"
    )
    zones = area_lamp.bug.zones.model_dump()
    assert sum(zone["value"] for zone in zones.values()) == pytest.approx(480.0 * np.pi, rel=1e-4)
    assert AreaLamp.of(PhotometrySection(), lamp, flux, zones_lm) is None
