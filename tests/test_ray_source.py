"""Rays given as arrays: the same light as the same rays from a file, to the bit; all else is refused in one line."""

from pathlib import Path

import numpy as np
import pytest
from scenes import small_spec

from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.rayfiles.ray_file_io import read_rayfile
from lensforge.spec.source_sections import RayfileSource, RaySource

LED = Path(__file__).parents[1] / "examples" / "led.tm25ray"


@pytest.fixture(scope="module")
def rays() -> np.ndarray:
    rayfile = read_rayfile(LED)
    return np.column_stack([rayfile.positions_mm, rayfile.directions, rayfile.flux]).astype(np.float64)


@pytest.mark.parametrize("placement", [{}, {"origin": "virtual_focus", "rotate_z_deg": 30.0, "scale": 0.5}])
def test_given_rays_are_placed_as_those_of_a_file(rays, placement):
    given = build_source(RaySource(rays, flux_w=2.0, **placement))
    read = build_source(RayfileSource(file=LED, model="rays", flux_w=2.0, **placement))
    for name in ("origins", "directions", "flux"):
        assert np.array_equal(getattr(given.rays, name), getattr(read.rays, name))
    assert given.ray_count == len(rays) and given.flux_w == 2.0


def test_without_a_power_the_rays_add_up_to_it_and_without_their_flux_they_are_alike(rays):
    assert build_source(RaySource(rays)).flux_w == pytest.approx(rays[:, 6].sum())
    alike = build_source(RaySource(rays[:, :6], flux_w=3.0))
    assert np.array_equal(alike.rays.flux, np.full(len(rays), 3.0 / len(rays)))


def test_rays_without_flux_are_left_out_and_counted(rays):
    few = rays[:10].copy()
    few[3, 6] = 0.0
    spec = RaySource(few)
    source = build_source(spec)
    summary = summarise(source, spec)
    assert source.ray_count == 9 and summary.rays == 10
    assert "1 of 10 rays dropped: 1 no flux" in summary.warnings


def test_each_ray_has_the_index_at_its_own_wavelength(rays):
    spec = small_spec(lens__material="PMMA")
    waves = np.linspace(450.0, 650.0, 100)
    given = RaySource(rays[:100], wavelengths_nm=waves)
    source = build_source(given, spec.lens.dispersion)
    assert np.array_equal(source.rays.wavelengths_nm, waves)
    assert np.array_equal(spec.lens.media.body.index(source.rays.waves), spec.lens.dispersion.index(waves))
    summary = summarise(source, given)
    assert summary.wavelengths_nm == (450.0, 650.0)
    assert summary.refractive_indices == tuple(spec.lens.dispersion.index(np.array([450.0, 650.0])))
