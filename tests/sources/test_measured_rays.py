"""Measured rays to design with: parts of a file, and the same light without the noise of its number of rays."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS
from lensforge.search.validation_rays import ValidationRays
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.dispersion import DispersedSource
from lensforge.sources.measured_rays import TurnedRays, divided, held_back, searched, smoothed
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.sources.source_pose import SourcePose, rotation_about
from lensforge.sources.source_spectrum import Spectrum
from lensforge.spec.accuracy import PRESETS


def lambertian(count: int, seed: int = 0) -> RayBundle:
    """Rays of a disc of 1 mm, caught on a plane 2 mm above it."""
    draw = np.random.default_rng(seed)
    radius, azimuth = np.sqrt(draw.random(count)), 2.0 * np.pi * draw.random(count)
    sine, turn = np.sqrt(0.95 * draw.random(count)), 2.0 * np.pi * draw.random(count)
    directions = np.stack([sine * np.cos(turn), sine * np.sin(turn), np.sqrt(1.0 - sine**2)], axis=1)
    points = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.zeros(count)], axis=1)
    return RayBundle(points + 2.0 / directions[:, 2:] * directions, directions, np.full(count, 1.0 / count))


def crossings(rays: RayBundle) -> Float[np.ndarray, "n 2"]:
    heights = rays.origins[:, 2:] / rays.directions[:, 2:]
    return (rays.origins - heights * rays.directions)[:, :2]


def test_rays_are_turned_about_the_source_and_by_the_stated_angle() -> None:
    whole = RaySetEmitter(lambertian(20_000), 1.0)
    turned = smoothed(whole)
    assert isinstance(turned, TurnedRays)
    assert turned.sigma_rad == pytest.approx(np.sqrt(300.0 / 20_000))
    before, after = whole.sample(20_000, 3), turned.sample(20_000, 3)
    assert np.allclose(crossings(after), crossings(before), atol=1e-9)
    assert np.allclose(after.origins[:, 2], 2.0) and np.allclose(np.linalg.norm(after.directions, axis=1), 1.0)
    across = np.linalg.norm(np.cross(before.directions, after.directions), axis=1)
    assert np.sqrt(np.mean(across**2)) == pytest.approx(np.sqrt(2.0) * turned.sigma_rad, rel=0.03)
    assert np.array_equal(after.flux, before.flux)


def test_more_rays_are_turned_less() -> None:
    few, many = (smoothed(RaySetEmitter(lambertian(count), 1.0)) for count in (2_000, 200_000))
    assert isinstance(few, TurnedRays) and isinstance(many, TurnedRays)
    assert few.sigma_rad == pytest.approx(0.15) and many.sigma_rad == pytest.approx(0.0387, rel=1e-3)


def test_samples_differ_and_are_the_same_again_by_seed() -> None:
    turned = smoothed(RaySetEmitter(lambertian(1_000), 1.0))
    first, again, other = turned.sample(1_000, 1), turned.sample(1_000, 1), turned.sample(1_000, 2)
    assert np.array_equal(first.directions, again.directions)
    assert not np.array_equal(first.directions, other.directions)


def test_a_tilted_source_is_turned_about_its_own_plane() -> None:
    pose = SourcePose(rotation_about("x", 0.4), np.array([0.3, -0.2, 1.0]))
    rays = lambertian(5_000)
    upright = RaySetEmitter(rays, 1.0)
    placed = replace(rays, origins=pose.points(rays.origins), directions=pose.directions(rays.directions))
    tilted = RaySetEmitter(placed, 1.0, pose=pose)
    expected, found = smoothed(upright).sample(5_000, 4), smoothed(tilted).sample(5_000, 4)
    assert np.allclose(pose.own_points(found.origins), expected.origins, atol=1e-12)
    assert np.allclose(pose.own_directions(found.directions), expected.directions, atol=1e-12)


def test_flat_and_backward_rays_are_not_turned_upside_down() -> None:
    directions = np.array([[1.0, 0.0, 0.0], [0.999, 0.0, 0.0447], [0.6, 0.0, -0.8]])
    rays = RaySetEmitter(RayBundle(np.full((3, 3), 0.1), directions, np.ones(3)), 3.0)
    turned = TurnedRays(rays, 0.1).sample(3, 0)
    assert np.array_equal(turned.directions[:2], directions[:2])
    assert turned.directions[2, 2] < -0.5 and turned.origins[2, 2] == pytest.approx(0.1)


def test_the_parts_of_a_file_are_disjoint_and_carry_its_flux() -> None:
    whole = RaySetEmitter(lambertian(1_000), 2.0)
    first, second = divided(whole, 0.8, 7)
    rows = [{tuple(row) for row in part.sample(part.ray_count or 0, 0).origins} for part in (first, second)]
    assert [len(each) for each in rows] == [800, 200]
    assert not rows[0] & rows[1] and rows[0] | rows[1] == {tuple(row) for row in whole.rays.origins}
    assert first.flux_w == second.flux_w == 2.0


def test_a_source_of_any_number_of_rays_stays_as_it_is() -> None:
    square = SquareEmitter(1.0, 1.0)
    assert divided(square, 0.8, 1) == (square, square) and held_back(square) is searched(square) is square
    assert smoothed(square) is square
    held, steps = ValidationRays.of(square, 64, 5)
    assert steps is square
    assert np.array_equal(held.samples[0].origins, square.sample(64, seeds.of_validation(5, 0)).origins)
    assert not np.array_equal(held.samples[0].origins, held.samples[1].origins)


def test_what_judges_a_lens_is_no_ray_of_any_search() -> None:
    whole = RaySetEmitter(lambertian(1_000), 2.0)
    judging, search = held_back(whole), searched(whole)
    assert (judging.ray_count, search.ray_count) == (300, 700) and judging.flux_w == search.flux_w == 2.0
    rows = {tuple(np.round(row, 9)) for row in crossings(judging.sample(300, 0))}
    for seed in range(3):
        held, steps = ValidationRays.of(search, 80, seed)
        for sample in (steps.sample(700, seed), *held.samples):
            assert not rows & {tuple(np.round(row, 9)) for row in crossings(sample)}


def test_of_a_large_file_all_is_held_back_but_what_a_step_takes() -> None:
    assert max(preset.effort.rays[1] for preset in PRESETS.values()) * 2 == 2**20
    one = RayBundle(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.ones(1))
    whole = RaySetEmitter(one.take(np.zeros(5_000_000, dtype=np.int8)), 1.0)
    assert searched(whole).ray_count == 2**20 and held_back(whole).ray_count == 5_000_000 - 2**20


def test_too_few_rays_to_hold_some_back_are_refused() -> None:
    assert held_back(RaySetEmitter(lambertian(54), 1.0)).ray_count == 16
    with pytest.raises(InputError, match=r"source: 53 rays are too few .* at least 54"):
        held_back(RaySetEmitter(lambertian(53), 1.0))


def test_rays_through_a_dispersive_lens_keep_their_indices() -> None:
    light = Spectrum(np.array([500.0, 600.0]), np.ones(2))
    dispersed = DispersedSource(RaySetEmitter(lambertian(1_000), 1.0), light, MATERIALS["PMMA"])
    held, steps = ValidationRays.of(dispersed, 80, 0)
    assert all(sample.refractive_indices is not None for sample in held.samples)
    assert steps.sample(100, 0).refractive_indices is not None
    assert isinstance(steps, DispersedSource) and isinstance(steps.source, TurnedRays)
