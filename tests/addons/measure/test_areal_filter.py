"""The areal filter against closed forms: transmission of waves and of noise, gradient, fading, choice by noise."""

import numpy as np
import pytest
from measured_lenses import directions, lens

from lensforge.addons.measure.areal_filter import ArealFilter, ChangedSurface, PointDeviations
from lensforge.addons.measure.first_cut import FilterRange, TriedFilter, longest_fitting, point_spacing_mm
from lensforge.cad.patch import fit_patch
from lensforge.errors import InputError
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere

RADIUS = 13.0
SPHERE = SrbfSurface(SrbfBasis((1,), 1.75), np.zeros(1), RADIUS)


def wave(u, length_mm):
    """A wave of 1 um along the great circles through the x axis."""
    return 1e-3 * np.cos(2.0 * np.pi * RADIUS * np.arctan2(u[:, 0], np.hypot(u[:, 1], u[:, 2])) / length_mm)


def passed_share(passed, u, length_mm, where):
    """Amplitude of the wave in ``passed``."""
    sine = wave(u, length_mm)[where]
    return np.sum(passed[where] * sine) / np.sum(sine**2)


def filtered(deviations, u, wavelength_mm):
    return ArealFilter(PointDeviations(SPHERE, u, deviations), wavelength_mm).solve()


def test_points_share_the_area_of_the_face_by_their_weights():
    """Each place twice, the second time with three times the weight of the first; a hemisphere has 2 pi R^2."""
    places = fibonacci_hemisphere(3000)
    weights = np.repeat([1.0, 3.0], len(places))
    points = PointDeviations(SPHERE, np.tile(places, (2, 1)), np.zeros(2 * len(places)), weights=weights)
    once, thrice = np.split(points.areas, 2)
    assert thrice == pytest.approx(3.0 * once, rel=1e-12)
    assert points.areas.sum() == pytest.approx(2.0 * np.pi * RADIUS**2, rel=1e-6)
    assert points.mean_square(np.repeat([2.0, 0.0], len(places))) == pytest.approx(1.0), "4 mm² on a quarter of it"


@pytest.mark.parametrize("ratio", [1.0, 1.5, 2.0, 4.0])
def test_a_wave_passes_as_the_spline_filter_says(ratio):
    u, length = fibonacci_hemisphere(8000), 2.5
    passed = filtered(wave(u, ratio * length), u, length).values
    share = passed_share(passed, u, ratio * length, np.abs(u[:, 0]) < 0.7)
    assert share == pytest.approx(1.0 / (1.0 + ratio**-4), abs=0.02)


def test_the_density_of_the_points_does_not_matter():
    """Without areas of the points, 7 times as many of them would pass 0.87 of the wave, and their absence 0.5."""
    even, extra = fibonacci_hemisphere(3000), directions(36000, 5)
    u = np.concatenate([even, extra[extra[:, 0] > 0.0]])
    passed = filtered(wave(u, 3.0), u, 3.0).values
    dense, sparse = ((side * u[:, 0] > 0.1) & (np.abs(u[:, 0]) < 0.7) for side in (1.0, -1.0))
    assert passed_share(passed, u, 3.0, dense) == pytest.approx(0.5, abs=0.05)
    assert passed_share(passed, u, 3.0, sparse) == pytest.approx(0.5, abs=0.05)


def test_noise_is_averaged_as_the_closed_form_says():
    """Variance of filtered white noise: sigma^2 a / (2 pi) times the integral of k / (1 + (k/kc)^4)^2, pi kc^2 / 8."""
    u, wavelength, sigma = fibonacci_hemisphere(6000), 2.5, 1e-3
    noise = sigma * np.random.default_rng(1).normal(size=len(u))
    change = filtered(noise, u, wavelength).change
    inner = directions(4000, 2)
    inner = inner[inner[:, 2] > 0.3]  # at the rim there are fewer neighbours
    area = 2.0 * np.pi * RADIUS**2 / len(u)
    wanted = sigma * np.sqrt(area / 16.0) * 2.0 * np.pi / wavelength
    assert np.sqrt(np.mean(change.radius(inner) ** 2)) == pytest.approx(wanted, rel=0.12)


def test_gradients_are_those_of_finite_differences():
    u, v = fibonacci_hemisphere(2000), directions(200, 3)
    part = ChangedSurface(lens().outer, filtered(wave(u, 6.0), u, 4.0).change)
    for axis in np.eye(3):
        tangent = axis - (v @ axis)[:, None] * v
        step = 1e-5
        there, here = ((v + sign * step * tangent) for sign in (1.0, -1.0))
        lengths = [np.linalg.norm(vectors, axis=1)[:, None] for vectors in (there, here)]
        slope = (part.radius(there / lengths[0]) - part.radius(here / lengths[1])) / (2.0 * step)
        np.testing.assert_allclose(slope, part.gradient(v) @ axis, atol=1e-6)


def test_the_face_of_a_change_follows_it_to_nanometres():
    u = fibonacci_hemisphere(4000)
    part = ChangedSurface(SPHERE, filtered(wave(u, 4.0), u, 3.0).change)
    v = directions(1000, 4)
    assert np.abs(fit_patch(part).radius(v) - part.radius(v)).max() < 2e-6


def test_it_fades_where_nothing_is_measured():
    u = fibonacci_hemisphere(8000)
    u = u[u[:, 0] > 0.0]
    change = filtered(np.full(len(u), 1e-3), u, 3.0).change
    inside, far = np.array([[0.6, 0.0, 0.8]]), np.array([[-0.96, 0.0, 0.28]])
    assert change.radius(inside)[0] == pytest.approx(1e-3, rel=0.01)
    assert abs(change.radius(far)[0]) < 5e-5


def test_the_spacing_is_the_pitch_of_a_grid_and_sees_the_gaps_between_lines():
    assert point_spacing_mm(PointDeviations(SPHERE, fibonacci_hemisphere(5000), np.zeros(5000))) == pytest.approx(
        np.sqrt(2.0 * np.pi / 5000.0) * RADIUS, rel=0.08
    )
    azimuth, turn = np.meshgrid(np.linspace(-0.5, 0.5, 11) * np.pi, np.linspace(-0.5, 0.5, 2000) * np.pi)
    lines = np.stack([np.sin(turn) * np.cos(azimuth), np.sin(turn) * np.sin(azimuth), np.cos(turn)], -1).reshape(-1, 3)
    spacing = point_spacing_mm(PointDeviations(SPHERE, lines, np.zeros(len(lines))))
    assert 1.5 < spacing < 0.1 * np.pi * RADIUS  # the mean area of a point would say 0.2 mm


def test_noise_alone_takes_long_waves_and_detail_short_ones():
    u = fibonacci_hemisphere(3000)
    noise = 3e-4 * np.random.default_rng(2).normal(size=len(u))

    def chosen(form):
        points = PointDeviations(SPHERE, u, form + noise)
        span = FilterRange.of(points)
        finest = TriedFilter.of(points, span.shortest_mm)
        assert finest.noise_mm == pytest.approx(3e-4, rel=0.1)
        return longest_fitting(points, span, finest).areal.wavelength_mm

    assert chosen(np.zeros(len(u))) > 8.0
    assert chosen(2.0 * wave(u, 4.0)) < 3.0


def test_noise_is_along_the_normal_of_a_face_that_is_inclined_to_the_rays():
    """A sphere whose centre is 0.7 of its radius above the origin: near the rim radial noise is 1.4 times as large."""
    face, u = sphere(6.0, 4.2), fibonacci_hemisphere(4000)
    noise = 3e-4 * np.random.default_rng(5).normal(size=len(u)) / np.sum(face.normal(u) * u, axis=1)
    points = PointDeviations(face, u, noise)
    span = FilterRange.of(points)
    finest = TriedFilter.of(points, span.shortest_mm)
    assert finest.noise_mm == pytest.approx(3e-4, rel=0.04)
    assert np.sum(points.areas) == pytest.approx(2.0 * np.pi * 6.0**2 * 1.7, rel=0.01), "of the cap above z = 0"
    assert longest_fitting(points, span, finest).areal.wavelength_mm > 0.4 * span.longest_mm


def test_a_wavelength_that_the_points_do_not_show_is_refused():
    span = FilterRange.of(PointDeviations(SPHERE, fibonacci_hemisphere(2000), np.zeros(2000)))
    span.require(span.shortest_mm)
    with pytest.raises(
        InputError, match=r"^wavelength_mm = 0\.5: must be from 2\.\d+ \(three spacings of the points, 0\."
    ):
        span.require(0.5)
    with pytest.raises(InputError, match="wavelength_mm = 20: must be from"):
        span.require(20.0)
    with pytest.raises(InputError, match=r"points: .* mm apart, must be at most 4\.33 on a face of 13 mm"):
        FilterRange.of(PointDeviations(SPHERE, fibonacci_hemisphere(2000)[::100], np.zeros(20)))
