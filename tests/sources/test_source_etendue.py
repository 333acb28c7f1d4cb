"""Étendue of a source from its rays, against sources whose radiance is known."""

from math import pi
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lensforge.scene.possible_light import EtendueCurve
from lensforge.sources.build_source import SquareEmitter, build_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec.source_sections import (
    ChipArraySource,
    DiscSource,
    LuminanceSource,
    RectangleSource,
    SourceSpec,
    SquareSource,
)

RAYS = 2**14


def cosine_power(power: float, side_mm: float = 2.0, seed: int = 0) -> RayBundle:
    """A square with intensity cos^power: its radiance goes with cos^(power - 1)."""
    rng = np.random.default_rng(seed)
    cosine, azimuth = rng.random(RAYS) ** (1.0 / (power + 1.0)), 2.0 * pi * rng.random(RAYS)
    sine = np.sqrt(1.0 - cosine**2)
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=1)
    origins = np.column_stack([(rng.random((RAYS, 2)) - 0.5) * side_mm, np.zeros(RAYS)])
    return RayBundle(origins, directions, np.full(RAYS, 1.0 / RAYS))


@pytest.mark.parametrize("power", [3.0, 20.0, 200.0])
def test_a_narrow_beam_is_brightest_on_its_axis(power: float) -> None:
    """The cone that holds a share s of cos^n has cos^(n + 1) = 1 - s at its edge, and pi A sin^2 of étendue."""
    curve = EtendueCurve.of(cosine_power(power))
    for share in (0.1, 0.3, 0.6):
        squared = (1.0 - share) ** (2.0 / (power + 1.0))
        assert 0.9 * share < curve.share_within(4.0 * pi * (1.0 - squared)) < 1.25 * share


def test_where_along_their_lines_rays_start_does_not_matter() -> None:
    rays = SquareEmitter(2.0).sample(RAYS, 3)
    moved = RayBundle(rays.origins + 30.0 * rays.directions, rays.directions, rays.flux)
    sideways = RayBundle(rays.origins + np.array([50.0, 0.0, 9.0]), -rays.directions, rays.flux)
    for other in (moved, sideways):
        for etendue in (0.1, 1.0, 5.0):
            expected = EtendueCurve.of(rays).share_within(etendue)
            assert EtendueCurve.of(other).share_within(etendue) == pytest.approx(expected, rel=1e-6)


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
def test_known_radiances_integrate_to_the_flux_and_agree_with_cells_of_rays(spec: SourceSpec) -> None:
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
        assert cells.share_within(etendue) == pytest.approx(share, rel=0.2)


def test_the_whole_etendue_of_uniform_emitters_is_pi_times_their_area() -> None:
    for spec, area in ((SOURCES[0], 4.0), (SOURCES[2], pi * 0.75**2), (SOURCES[3], 6 * 0.2)):
        source = build_source(spec)
        known = EtendueCurve.of_source(source, source.sample(RAYS, 3), 3)
        assert known.etendue_mm2_sr[-1] == pytest.approx(pi * area, rel=1e-9)


def test_a_luminance_image_has_the_radiance_of_its_pixels(tmp_path: Path) -> None:
    Image.fromarray(np.array([[200, 100], [0, 50]], dtype=np.uint8)).save(tmp_path / "chip.png")
    source = build_source(LuminanceSource(file=tmp_path / "chip.png", width_mm=2.0))
    known = EtendueCurve.of_source(source, source.sample(RAYS, 3), 3)
    assert known.share_within(pi) == pytest.approx(200.0 / 350.0, rel=0.01)
    assert known.share_within(2.0 * pi) == pytest.approx(300.0 / 350.0, rel=0.01)
    assert known.etendue_mm2_sr[-1] == pytest.approx(3.0 * pi, rel=0.01)
