"""Measured rays to design with: parts of a file, and the same light without the noise of its number of rays."""

import numpy as np
import pytest
from jaxtyping import Float

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS
from lensforge.search.validation_rays import HeldRays
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.dispersion import DispersedSource
from lensforge.sources.measured_rays import TurnedRays, divided, held_back, searched, smoothed
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.ray_set import RaySetEmitter
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


def test_a_source_of_any_number_of_rays_stays_as_it_is() -> None:
    square = SquareEmitter(1.0, 1.0)
    assert divided(square, 0.8, 1) == (square, square) and held_back(square) is searched(square) is square
    assert smoothed(square) is square
    held, steps = HeldRays.of(square, 64, 5)
    assert steps is square
    assert np.array_equal(held.samples[0].origins, square.sample(64, seeds.of_held(5, 0)).origins)
    assert not np.array_equal(held.samples[0].origins, held.samples[1].origins)


def test_what_judges_a_lens_is_no_ray_of_any_search() -> None:
    whole = RaySetEmitter(lambertian(1_000), 2.0)
    judging, search = held_back(whole), searched(whole)
    assert (judging.ray_count, search.ray_count) == (300, 700) and judging.flux_w == search.flux_w == 2.0
    rows = {tuple(np.round(row, 9)) for row in crossings(judging.sample(300, 0))}
    for seed in range(3):
        held, steps = HeldRays.of(search, 80, seed)
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
    held, steps = HeldRays.of(dispersed, 80, 0)
    assert all(sample.refractive_indices is not None for sample in held.samples)
    assert steps.sample(100, 0).refractive_indices is not None
    assert isinstance(steps, DispersedSource) and isinstance(steps.source, TurnedRays)
