"""Étendue, indices, and spectra of sources by plain loops over their rays and by exact integrals."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS
from lensforge.scene.possible_light import EtendueCurve, _cells, _curve, _phase_space
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.dispersion import (
    DispersedSource,
    IndexAccount,
    IndexRange,
    dispersed,
    in_material,
    index_of_spectrum,
    known_or,  # fmt: skip
)
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.source_pose import PlacedSource, SourcePose, rotation_about
from lensforge.sources.source_spectrum import Spectrum, WavelengthDraw, usable_wavelengths

PMMA = MATERIALS["PMMA"]


def test_a_curve_of_etendue_begins_with_the_brightest_cells() -> None:
    """Radiances 4, 1 and 2, a dark cell, and two without extent."""
    volume, flux = np.array([1.0, 0.0, 2.0, 0.5, 3.0, -0.0]), np.array([4.0, 0.5, 2.0, 1.0, 0.0, 1.5])
    found = _curve(volume, flux, estimated=True)
    np.testing.assert_allclose(found.etendue_mm2_sr, [0.0, 1.0, 1.5, 3.5, 6.5])
    np.testing.assert_allclose(found.share, np.array([2.0, 6.0, 7.0, 9.0, 9.0]) / 9.0)
    assert found.estimated
    assert found.share_within(0.25) == pytest.approx(3.0 / 9.0) and found.share_within(99.0) == 1.0
    np.testing.assert_allclose(found.shares_within(np.array([[0.25, 1.25]])), [[3.0 / 9.0, 6.5 / 9.0]])


def cells_by_halving(points: np.ndarray, flux: np.ndarray) -> list[tuple[float, float]]:
    """Halve at the median of the side that is widest of all rays' own, until a cell has less than 64 rays."""
    levels = int(np.log2(len(flux) / 32))
    each = len(flux) >> levels
    used, left_over = each << levels, flux[each << levels :].sum()
    scale = np.ptp(points, axis=0)
    parts = [np.arange(used)]
    for _ in range(levels):
        halves = []
        for part in parts:
            widest = int(np.argmax(np.ptp(points[part], axis=0) / scale))
            ordered = part[np.argsort(points[part, widest])]
            halves += [ordered[: len(part) // 2], ordered[len(part) // 2 :]]
        parts = halves
    total = flux[:used].sum()
    found = []
    for part in parts:
        sides = np.ptp(points[part], axis=0) * (each + 1) / (each - 1)
        found.append((float(np.prod(sides)), float(flux[part].sum() * (1.0 + left_over / total))))
    return found


def slanted(count: int) -> RayBundle:
    random = np.random.default_rng(count)
    ways = random.normal(size=(count, 3)) * [0.5, 0.3, 0.2] + [0.2, 0.0, 1.0]
    ways[:, 2] = np.abs(ways[:, 2]) + 0.05
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return RayBundle(random.normal(size=(count, 3)), ways, random.uniform(0.5, 2.0, count))


@pytest.mark.parametrize("count", [64, 100, 333])
def test_cells_are_halves_of_halves_of_the_rays(count: int) -> None:
    rays = slanted(count)
    volume, flux = _cells(rays, np.ones(count, dtype=bool))
    expected = cells_by_halving(_phase_space(rays.origins, rays.directions, rays.flux), rays.flux)
    np.testing.assert_allclose(np.stack([volume, flux], axis=1), expected, rtol=1e-9)
    assert flux.sum() == pytest.approx(rays.flux.sum())


def test_fewer_rays_than_two_cells_have_no_extent() -> None:
    rays = slanted(64)
    volume, flux = _cells(rays, np.arange(64) < 63)
    assert volume.tolist() == [0.0] and flux.tolist() == [pytest.approx(rays.flux[:63].sum())]


def test_rays_are_taken_where_they_lie_closest_together() -> None:
    """Of their crossings of planes z = const, weighted with the fourth power of the cosine: least mean square."""
    rays = slanted(200)
    weights = rays.flux * rays.directions[:, 2] ** 4

    def at(z_mm: float) -> np.ndarray:
        away = (z_mm - rays.origins[:, 2]) / rays.directions[:, 2]
        return rays.origins[:, :2] + away[:, None] * rays.directions[:, :2]

    def spread(z_mm: float) -> float:
        found = at(z_mm)
        return float((weights[:, None] * (found - np.average(found, axis=0, weights=weights)) ** 2).sum())

    fit = np.polyfit([-1.0, 0.0, 1.0], [spread(z) for z in (-1.0, 0.0, 1.0)], 2)
    points = _phase_space(rays.origins, rays.directions, rays.flux)
    np.testing.assert_allclose(points[:, :2], at(-fit[1] / (2.0 * fit[0])), atol=1e-9)
    np.testing.assert_array_equal(points[:, 2:], rays.directions[:, :2])
    beam = _phase_space(rays.origins, np.tile([0.0, 0.0, 1.0], (200, 1)), rays.flux)
    np.testing.assert_array_equal(beam[:, :2], rays.origins[:, :2])


def test_level_rays_have_no_extent_and_each_side_of_the_horizon_its_own_cells() -> None:
    rise = np.array([*[1e-3] * 30, *[-1e-3] * 30, 1.1e-3])
    level = RayBundle(np.zeros((61, 3)), np.stack([np.sqrt(1.0 - rise**2), 0.0 * rise, rise], axis=1), np.ones(61))
    curve = EtendueCurve.of(RayBundle.joined([level, slanted(128)]))
    total = 61.0 + slanted(128).flux.sum()
    assert curve.share[0] == pytest.approx(60.0 / total), "the steepest of them counts with the others"
    assert len(curve.share) == 1 + 4


def test_a_source_that_is_moved_and_dispersed_has_its_own_radiances() -> None:
    pose = SourcePose(rotation_about("x", 0.3), np.array([1.0, 0.0, 2.0]))
    source = DispersedSource(PlacedSource(SquareEmitter(2.0, 3.0), pose), Spectrum(np.array([500.0]), np.ones(1)), PMMA)
    found = EtendueCurve.of_source(source, source.sample(64, 1), 1)
    assert not found.estimated and found.etendue_mm2_sr[-1] == pytest.approx(4.0 * np.pi)


WAVES = np.array([300.0, 378.0, 377.9, 419.9, 420.0, 500.0, 1620.0, 1620.1, 1782.0, 1782.1, np.nan, 0.5])
FLUX = 2.0 ** -np.arange(12.0)


def test_light_is_counted_by_what_is_known_at_its_wavelength_ends_included() -> None:
    account = IndexAccount(PMMA)
    for part in (slice(0, 5), slice(5, 12)):
        account.add(FLUX[part], WAVES[part])
    assert [*PMMA.range_nm, *PMMA.trusted_nm] == pytest.approx([420.0, 1620.0, 378.0, 1782.0])
    assert account.flux == pytest.approx(FLUX.sum()) and account.coloured == pytest.approx(FLUX[:10].sum())
    assert account.clamped == pytest.approx(FLUX[[0, 2, 9, 10, 11]].sum())
    assert account.extrapolated == pytest.approx(FLUX[[1, 3, 7, 8]].sum())
    assert (account.low_nm, account.high_nm) == (300.0, 1782.1)
    assert account.mean_nm == pytest.approx(FLUX[:10] @ WAVES[:10] / FLUX[:10].sum())
    assert known_or(555.0, WAVES).tolist() == [*WAVES[:10], 555.0, 555.0]
    with pytest.raises(InputError, match="lamp: no ray has a usable wavelength"):
        IndexAccount(PMMA).index_range("lamp")


@pytest.mark.parametrize(("share", "refused"), [(0.01, False), (0.0101, True)])
def test_one_per_cent_may_have_the_index_at_the_end_of_the_range(share: float, refused: bool) -> None:
    flux, waves = np.array([share, 0.2, 0.8 - share]), np.array([1800.0, 400.0, 600.0])
    rays = RayBundle(np.zeros((3, 3)), np.tile([0.0, 0.0, 1.0], (3, 1)), flux)
    if refused:
        with pytest.raises(InputError, match=r"1\.01 % of the flux is outside, at most 1 % may be"):
            dispersed(rays, waves, PMMA, "lamp")
        return
    found, known = dispersed(rays, waves, PMMA, "lamp")
    assert known.clamped_share == pytest.approx(0.01) and known.extrapolated_share == pytest.approx(0.2)
    assert known.wavelengths_nm == (400.0, 1800.0)
    indices = [PMMA.index_at(400.0), float(PMMA.nearest_index(np.array([1800.0]))[0])]
    assert list(known.refractive_indices) == pytest.approx(indices)
    assert found.refractive_indices.tolist() == pytest.approx([indices[1], indices[0], PMMA.index_at(600.0)])
    assert found.wavelengths_nm.tolist() == waves.tolist() and found.flux.tolist() == flux.tolist()
    assert (in_material(rays, waves, PMMA).absorption_per_mm is None) == (PMMA.absorption is None)


@pytest.mark.parametrize(
    ("extrapolated", "clamped", "words"), [(0.01, 0.0, []), (0.0101, 0.0, ["1.01 %"]), (0.5, 1e-9, ["50 %", "1e-07 %"])]
)
def test_more_than_one_per_cent_is_mentioned_and_any_light_beyond_what_is_known(extrapolated, clamped, words) -> None:
    found = IndexRange((400.0, 600.0), (1.5, 1.49), extrapolated, clamped)
    assert [each.split(" of the flux")[0] for each in found.warnings(PMMA)] == words
    assert found.fields() == {
        "wavelengths_nm": (400.0, 600.0),
        "refractive_indices": (1.5, 1.49),
        "extrapolated_index_share": extrapolated,
        "clamped_index_share": clamped,
    }


@pytest.mark.parametrize(
    ("waves", "density", "ends"),
    [
        ([390.0, 430.0, 500.0, 600.0, 700.0], [0.0, 0.0, 1.0, 0.0, 0.0], (430.0, 600.0)),
        ([430.0, 500.0, 600.0], [1.0, 2.0, 1.0], (430.0, 600.0)),
        ([400.0, 430.0, 500.0, 600.0], [0.0, 1.0, 2.0, 0.0], (400.0, 600.0)),
        ([1500.0, 1600.0, 1640.0], [0.0, 1.0, 0.0], (1500.0, 1640.0)),
    ],
)
def test_a_spectrum_ends_where_its_light_ends_and_is_counted_exactly(waves, density, ends) -> None:
    found = index_of_spectrum(Spectrum(np.array(waves), np.array(density)), PMMA)
    assert found.wavelengths_nm == ends and found.clamped_share == 0.0

    def light(low: float, high: float) -> float:
        edges = [low, *[wave for wave in waves if low < wave < high], high]
        at = pairwise(edges)
        return sum(quad(lambda wave: np.interp(wave, waves, density, 0.0, 0.0), *part)[0] for part in at)

    outside = light(378.0, 420.0) + light(1620.0, 1782.0)
    assert found.extrapolated_share == pytest.approx(outside / light(378.0, 1782.0), abs=1e-12)


def test_wavelengths_are_drawn_one_from_each_share_part_by_part() -> None:
    spectrum = Spectrum(np.array([400.0, 500.0, 700.0]), np.array([1.0, 3.0, 0.5]))
    random = np.random.default_rng([7, 5])
    order, numbers = random.permutation(10), [random.random(4), random.random(6)]
    draw = WavelengthDraw.of(spectrum, 10, 7)
    parts = [draw.take(4), draw.take(6)]
    for part, shares, some in zip(parts, (order[:4], order[4:]), numbers, strict=True):
        for wave, share in zip(part, (shares + some) / 10.0, strict=True):
            power = quad(lambda x: np.interp(x, [400.0, 500.0, 700.0], [1.0, 3.0, 0.5]), 400.0, wave, points=[500.0])[0]
            assert power / 550.0 == pytest.approx(share, abs=1e-9)
            assert spectrum.share_up_to(float(wave)) == pytest.approx(share, abs=1e-12)
    line = Spectrum(np.array([633.0]), np.ones(1))
    assert line.at(np.array([0.0, 0.9])).tolist() == [633.0, 633.0]
    assert (line.share_up_to(633.0), line.share_up_to(632.9)) == (1.0, 0.0)


@pytest.mark.parametrize(
    ("waves", "density", "accepted"),
    [
        ([1.0, 9_999_999.0], [1.0, 1.0], True), ([0.999, 2.0], [1.0, 1.0], False), ([1.0, 1e7], [1.0, 1.0], False),
        ([500.0, 500.0], [1.0, 1.0], False), ([500.0, 500.0 + 2e-6], [1.0, 1.0], True),
        ([500.0, 500.0 + 5e-7], [1.0, 1.0], False), ([500.0, 400.0], [1.0, 1.0], False),
        ([500.0, 600.0], [0.0, 0.0], False), ([500.0, 600.0], [0.0, 1.1e-30], True),
        ([500.0, 600.0], [0.0, 1e-30], False), ([500.0, 600.0], [0.0, 1e30], False),
        ([500.0, 600.0], [0.0, 0.99e30], True), ([500.0, 600.0], [-1e-9, 1.0], False),
    ],
)  # fmt: skip
def test_a_spectrum_rises_and_has_finite_light(waves: list[float], density: list[float], accepted: bool) -> None:
    if accepted:
        assert usable_wavelengths(Spectrum(np.array(waves), np.array(density)).wavelengths_nm).all()
    else:
        with pytest.raises(InputError, match=r"^spectrum: "):
            Spectrum(np.array(waves), np.array(density))
