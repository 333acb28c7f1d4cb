"""Étendue of a source: cells of its rays by loops, and sources whose radiance is known."""

from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lensforge.optics.material import MATERIALS
from lensforge.optics.pose import Pose
from lensforge.scene.possible_light import EtendueCurve, _cells, _curve, _phase_space
from lensforge.sources.build_source import PlacedSource, SquareEmitter, build_source
from lensforge.sources.dispersion import ColouredSource
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.source_spectrum import Spectrum
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.source_sections import ChipArraySource, DiscSource, LuminanceSource, RectangleSource, SquareSource

RAYS = 2**14


SOURCES = [
    SquareSource(side_mm=2.0),
    RectangleSource(width_mm=2.0, height_mm=1.0, intensity={"kind": "cosine", "power": 3.0}, tilt_deg=(20.0, 0.0)),
    DiscSource(diameter_mm=1.5, position_mm=(0.3, 0.0, 0.1)),
    ChipArraySource(columns=3, rows=2, width_mm=0.5, height_mm=0.4, pitch_mm=(0.7, 0.6)),
    DiscSource(
        diameter_mm=1.5, intensity={"kind": "table", "gamma_deg": [0.0, 30.0, 70.0], "intensity": [1.0, 2.0, 0.0]}
    ),
]


@pytest.mark.parametrize("spec", SOURCES, ids=lambda spec: f"{spec.kind}")
def test_known_radiances_integrate_to_the_flux_and_agree_with_cells_of_rays(spec: EmitterSection) -> None:
    """Over all rays, flux over radiance is the étendue of the lit phase space; no ray is without radiance."""
    source = build_source(spec)
    known = EtendueCurve.of_source(source, source.sample(RAYS, 3), 3)
    cells = EtendueCurve.of(source.sample(RAYS, 3))
    assert cells.estimated and not known.estimated
    assert (
        known.share[-1] == pytest.approx(1.0) and known.share[0] == 0.0 and (np.diff(known.etendue_mm2_sr) > 0.0).all()
    )
    for share in (0.2, 0.5, 0.8):
        etendue = float(np.interp(share, known.share, known.etendue_mm2_sr))
        assert cells.shares_within(etendue) == pytest.approx(share, rel=0.2)


def test_the_whole_etendue_of_uniform_emitters_is_pi_times_their_area() -> None:
    for spec, area in ((SOURCES[0], 4.0), (SOURCES[2], pi * 0.75**2), (SOURCES[3], 6 * 0.2)):
        source = build_source(spec)
        known = EtendueCurve.of_source(source, source.sample(RAYS, 3), 3)
        assert known.etendue_mm2_sr[-1] == pytest.approx(pi * area, rel=1e-9)


def test_a_luminance_image_has_the_radiance_of_its_pixels(tmp_path: Path) -> None:
    Image.fromarray(np.array([[200, 100], [0, 50]], dtype=np.uint8)).save(tmp_path / "chip.png")
    source = build_source(LuminanceSource(file=tmp_path / "chip.png", width_mm=2.0))
    known = EtendueCurve.of_source(source, source.sample(RAYS, 3), 3)
    assert known.shares_within(pi) == pytest.approx(200.0 / 350.0, rel=0.01)
    assert known.shares_within(2.0 * pi) == pytest.approx(300.0 / 350.0, rel=0.01)
    assert known.etendue_mm2_sr[-1] == pytest.approx(3.0 * pi, rel=0.01)


PMMA = MATERIALS["PMMA"]


def test_a_curve_of_etendue_begins_with_the_brightest_cells() -> None:
    """Radiances 4, 1 and 2, a dark cell, and two without extent."""
    volume, flux = np.array([1.0, 0.0, 2.0, 0.5, 3.0, -0.0]), np.array([4.0, 0.5, 2.0, 1.0, 0.0, 1.5])
    curve = _curve(volume, flux, estimated=True)
    np.testing.assert_allclose(curve.etendue_mm2_sr, [0.0, 1.0, 1.5, 3.5, 6.5])
    np.testing.assert_allclose(curve.share, np.array([2.0, 6.0, 7.0, 9.0, 9.0]) / 9.0)
    assert curve.estimated
    assert curve.shares_within(0.25) == pytest.approx(3.0 / 9.0) and curve.shares_within(99.0) == 1.0
    np.testing.assert_allclose(curve.shares_within(np.array([[0.25, 1.25]])), [[3.0 / 9.0, 6.5 / 9.0]])


def cells_by_halving(points: np.ndarray, flux: np.ndarray) -> list[tuple[float, float]]:
    """Halve at the median of the side that is widest of all rays' own, until a cell has less than 64 rays."""
    levels = int(np.log2(len(flux) / 32))
    per_cell = len(flux) >> levels
    used, left_over = per_cell << levels, flux[per_cell << levels :].sum()
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
    cells = []
    for part in parts:
        sides = np.ptp(points[part], axis=0) * (per_cell + 1) / (per_cell - 1)
        cells.append((float(np.prod(sides)), float(flux[part].sum() * (1.0 + left_over / total))))
    return cells


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
    expected = cells_by_halving(_phase_space(rays), rays.flux)
    np.testing.assert_allclose(np.stack([volume, flux], axis=1), expected, rtol=1e-9)
    assert flux.sum() == pytest.approx(rays.flux.sum())


def test_rays_are_taken_where_they_lie_closest_together() -> None:
    """Of their crossings of planes z = const, weighted with the fourth power of the cosine: least mean square."""
    rays = slanted(200)
    weights = rays.flux * rays.directions[:, 2] ** 4

    def at(z_mm: float) -> np.ndarray:
        away = (z_mm - rays.origins[:, 2]) / rays.directions[:, 2]
        return rays.origins[:, :2] + away[:, None] * rays.directions[:, :2]

    def spread(z_mm: float) -> float:
        places = at(z_mm)
        return float((weights[:, None] * (places - np.average(places, axis=0, weights=weights)) ** 2).sum())

    fit = np.polyfit([-1.0, 0.0, 1.0], [spread(z) for z in (-1.0, 0.0, 1.0)], 2)
    points = _phase_space(rays)
    np.testing.assert_allclose(points[:, :2], at(-fit[1] / (2.0 * fit[0])), atol=1e-9)
    np.testing.assert_array_equal(points[:, 2:], rays.directions[:, :2])
    beam = _phase_space(replace(rays, directions=np.tile([0.0, 0.0, 1.0], (200, 1))))
    np.testing.assert_array_equal(beam[:, :2], rays.origins[:, :2])


def test_a_source_that_is_moved_and_dispersed_has_its_own_radiances() -> None:
    pose = Pose.of_tilts((1.0, 0.0, 2.0), (20.0, 0.0))
    line = Spectrum(np.array([500.0]), np.ones(1))
    source = ColouredSource.of(PlacedSource(SquareEmitter(2.0, 3.0), pose), line, PMMA)
    curve = EtendueCurve.of_source(source, source.sample(64, 1), 1)
    assert not curve.estimated and curve.etendue_mm2_sr[-1] == pytest.approx(4.0 * np.pi)
