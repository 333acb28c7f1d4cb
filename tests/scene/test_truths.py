"""Closed forms of light on receivers: the photometric laws of distance and cosine, and the same rays seen otherwise."""

import numpy as np
import pytest
from presets import FEW
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.light.simulation import TracedLens
from lensforge.optics.pose import Pose
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.lens import Lens
from lensforge.scene.pixel_grid import PixelGrid, bin_flux
from lensforge.scene.receiver_shapes import FarField, Plane, chart_radius, receivers_of
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec
from lensforge.surfaces.asphere import sphere

UPRIGHT = Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
OUTER_MM = 6.0


def bumpy_lens(spec: Spec) -> TracedLens:
    return TracedLens.of(Lens.double(random_surface(1, 3.0), random_surface(2, OUTER_MM), spec, 0, "draft"), 4.0)


def exit_rays(count: int = 2**15) -> ExitRays:
    spec = small_spec()
    return bumpy_lens(spec).trace(build_source(spec.source).sample(count, 1))


def test_intensity_is_irradiance_a_hundred_thousand_radii_away_times_the_square_of_the_distance() -> None:
    """Pixels of a far field, and the same directions on a plane: I = E D^2 / cos^3."""
    rays = exit_rays()
    distance_mm = 1e5 * OUTER_MM
    far = FarField(UPRIGHT, PixelGrid.square(2.0 * chart_radius(60.0), 64))
    plane = Plane(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, distance_mm)), PixelGrid.square(1e12, 2))
    directions = far.land(rays)
    landed = plane.land(rays)
    both = directions.landed & landed.landed
    radius = np.hypot(*landed.hits[both].T) / distance_mm  # tan gamma
    seen = np.hypot(*directions.hits[both].T)
    gamma = np.arctan(radius)
    assert both.sum() > 10_000 and np.abs(seen - 2.0 * np.sin(0.5 * gamma)).max() < 2e-5
    low = np.radians(25.0)
    high = np.radians(26.0)
    in_cone = (seen > 2.0 * np.sin(0.5 * low)) & (seen < 2.0 * np.sin(0.5 * high))
    intensity = directions.flux[both][in_cone].sum()
    intensity /= 2.0 * np.pi * (np.cos(low) - np.cos(high))
    irradiance = landed.flux[both][(radius > np.tan(low)) & (radius < np.tan(high))].sum()
    irradiance /= np.pi * distance_mm**2 * (np.tan(high) ** 2 - np.tan(low) ** 2)
    assert irradiance * distance_mm**2 / np.cos(np.radians(25.5)) ** 3 == pytest.approx(intensity, rel=1e-3)


def bare_spec() -> Spec:
    """A small Lambertian source without a lens, that is with one of index 1, and three receivers."""
    return small_spec(
        lens__refractive_index=1.0, lens__material="air", source__side_mm=0.02, target=None,
        receivers=[
            {"kind": "far_field", "half_angle_deg": 80.0, "targets": [{"kind": "beam", "fwhm_deg": 60.0}]},
            {"kind": "plane", "centre_mm": [0.0, 0.0, 100.0], "width_mm": 300.0, "height_mm": 200.0,
             "targets": [{"kind": "disc", "diameter_mm": 100.0}]},
            {"kind": "sphere", "radius_mm": 100.0, "half_angle_deg": 80.0,
             "targets": [{"kind": "disc", "diameter_mm": 100.0}]},
        ],
    )  # fmt: skip


RECEIVERS = bare_spec().model_dump(exclude_unset=True)["receivers"][:2]


@pytest.fixture(scope="module")
def bare() -> lf.Light:
    return lf.evaluate(Lens.double(sphere(3.0), sphere(6.0), bare_spec(), 0, FEW), rays=2**20, pixels=32)


def image(lens: TracedLens, source: Source, number: int) -> np.ndarray:
    """Flux per W on the pixels of one of the receivers."""
    receiver = receivers_of(small_spec(target=None, receivers=RECEIVERS), 16)[number]
    landings = receiver.land(lens.trace(source.sample(2**17, 3)))
    return bin_flux(landings.hits, landings.flux, receiver.grid) / source.flux_w


def cosines(number: int, spec: Spec) -> np.ndarray:
    """Cosine from the axis of the direction to the middle of each pixel."""
    receiver = receivers_of(spec, 32)[number]
    places = receiver.places(*np.meshgrid(receiver.grid.x(), receiver.grid.y()))
    cosine: np.ndarray = places[..., 2] / np.linalg.norm(places, axis=-1)
    return cosine


def test_a_lambertian_source_without_a_lens_has_cos_and_cos4(bare: lf.Light) -> None:
    """Per W I = cos(gamma) / pi; E = cos^4 / (pi D^2) on a plane across the axis, cos / (pi R^2) on a sphere."""
    spec = bare_spec()
    for number, power, scale in ((0, 1, 1.0), (1, 4, 0.1**-2), (2, 1, 0.1**-2)):
        light = bare.receivers[number]
        receiver = receivers_of(spec, 32)[number]
        cosine = cosines(number, spec)
        expected = scale * cosine**power / np.pi
        window = receiver.window.pixels(receiver.grid) & (cosine > 0.25)
        lit = np.pad(window, 1)
        inner = window & lit[:-2, 1:-1] & lit[2:, 1:-1] & lit[1:-1, :-2] & lit[1:-1, 2:]  # no pixel at the rim
        ratio = light.raw_map[inner] / expected[inner]
        assert inner.sum() > 200 and abs(ratio.mean() - 1.0) < 3e-3 and np.abs(ratio - 1.0).max() < 0.1, light.name


def test_light_of_sources_adds_up_on_every_receiver() -> None:
    """An array of two chips makes the light of each, moved: the same map to the noise of the rays, the same flux."""
    chips = [
        {"x_mm": x_mm, "y_mm": 0.2, "width_mm": 0.5, "height_mm": 0.4, "flux_w": flux_w}
        for x_mm, flux_w in ((-0.6, 1.0), (0.5, 3.0))
    ]
    spec = small_spec(target=None, receivers=RECEIVERS)
    lens = bumpy_lens(spec)
    both, *alone = (build_source(lf.ChipsSource(chips=some)) for some in (chips, chips[:1], chips[1:]))
    whole = [image(lens, both, number) for number in (0, 1)]
    for number in (0, 1):
        parts = 0.25 * image(lens, alone[0], number) + 0.75 * image(lens, alone[1], number)
        assert np.abs(whole[number] - parts).sum() < 0.03 * whole[number].sum()
        assert whole[number].sum() == pytest.approx(parts.sum(), rel=2e-3)
