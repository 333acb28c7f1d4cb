"""Spectrum of the light that leaves the lens: rays counted at wavelengths, and powers of parts that are mixed."""

from dataclasses import replace

import numpy as np
import pytest
from rayfile_samples import rays, with_tables

from lensforge.light.exit_light import _reach_deg
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.joined_spectrum import _mixed, _of_rays, spectrum_of_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.rayfiles.ray_file_io import write_rayfile
from lensforge.sources.source_spectrum import Spectrum
from lensforge.spec.source_sections import ChipsSource, RayfileSource, RayfilesSource, RaySource, SquareSource


def test_rays_of_one_wavelength_are_a_line():
    result = _of_rays(lambda: [(np.full(3, 621.3), np.ones(3))])
    assert (result.wavelengths_nm.tolist(), result.power_density.tolist()) == ([621.3], [1.0])


def test_a_table_of_rays_has_their_mean_wavelength_whatever_their_blocks():
    waves = np.linspace(451.3, 652.2, 20_001)
    flux = 1.0 + np.sin(waves / 30.0) ** 2
    blocks = [(waves[part], flux[part]) for part in (slice(None, 700), slice(700, None))]
    table = _of_rays(lambda: blocks)
    assert np.average(table.wavelengths_nm, weights=table.power_density) == pytest.approx(
        np.average(waves, weights=flux), abs=0.05
    )
    assert table.power_density.max() == 1.0 and np.diff(table.wavelengths_nm) == pytest.approx(5.0)
    assert table.power_density[0] == table.power_density[-1] == 0.0, "it ends beside the rays"


def test_parts_have_in_their_mixture_the_powers_that_they_have():
    """A line of 3 W and a triangle of 1 W, of which the areas are the powers."""
    line = Spectrum(np.array([450.0]), np.ones(1))
    table = Spectrum(np.array([550.0, 600.0, 650.0]), np.array([0.0, 4.0, 0.0]))
    result = _mixed([line, table], [3.0, 1.0])
    below = result.wavelengths_nm < 500.0
    areas = [np.trapezoid(result.power_density[part], result.wavelengths_nm[part]) for part in (below, ~below)]
    assert areas[0] / areas[1] == pytest.approx(3.0)
    assert result.power_density.max() == 1.0
    assert result.wavelengths_nm[below].tolist() == [445.0, 450.0, 455.0]


def test_the_reach_is_the_angle_that_holds_nearly_all_the_flux():
    gamma = np.deg2rad([5.0, 60.0, 20.0, 80.0])
    ways = np.stack([np.sin(gamma), np.zeros(4), np.cos(gamma)], axis=1)

    def reach(*flux):
        return _reach_deg(RayBundle(np.zeros((4, 3)), ways, np.array(flux)))

    assert reach(0.5, 0.004, 0.496, 0.0) == pytest.approx(20.0)  # within 99.5 % of the flux
    assert reach(0.5, 0.006, 0.494, 0.0) == pytest.approx(60.0)
    assert reach(0.5, 0.2, 0.2, 0.1) == pytest.approx(80.0)
    nothing = RayBundle(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    assert _reach_deg(nothing) == 90.0


ROWS = np.column_stack([np.zeros((3, 3)), np.tile([0.0, 0.0, 1.0], (3, 1)), [1.0, 2.0, 5.0]])


def spectrum(spec):
    return spectrum_of_source(spec, summarise(build_source(spec), spec))


def test_given_rays_have_the_spectrum_of_their_wavelengths_and_fluxes():
    waves = [500.0, 500.0, 600.0]
    result = spectrum(RaySource(ROWS, flux_w=1.0, wavelengths_nm=waves))
    lit = result.power_density > 0.0
    assert result.wavelengths_nm[lit].tolist() == [500.0, 600.0]
    assert result.power_density[lit].tolist() == pytest.approx([0.6, 1.0])
    even = spectrum(RaySource(ROWS[:, :6], flux_w=1.0, wavelengths_nm=waves))
    assert even.power_density[even.power_density > 0.0].tolist() == pytest.approx([1.0, 0.5])
    assert spectrum(RaySource(ROWS, flux_w=1.0)) is None
    assert spectrum(SquareSource(side_mm=1.0)) is None
    line = spectrum(SquareSource(side_mm=1.0, spectrum={"kind": "line", "wavelength_nm": 633.0}))
    assert line.wavelengths_nm.tolist() == [633.0]


def test_files_have_the_spectrum_of_their_rays_by_power_or_none_where_one_is_unknown(tmp_path):
    """Equal lumens at 450 and 555 nm: the blue ray has more power by the ratio of their efficacies."""
    made = replace(rays(2, unit="lm"), flux=np.ones(2, np.float32), header_flux_lm=2.0)
    write_rayfile(tmp_path / "seen.csv", replace(made, wavelengths_nm=np.array([450.0, 555.0])), "csv")
    write_rayfile(tmp_path / "dark.csv", replace(made, wavelengths_nm=np.array([450.0, 900.0])), "csv")
    write_rayfile(tmp_path / "grey.csv", made, "csv")
    seen = spectrum(RayfileSource(file=tmp_path / "seen.csv"))
    power = seen.power_density[seen.power_density > 0.0]
    assert power.tolist() == pytest.approx([1.0, 0.038], rel=1e-3)
    assert spectrum(RayfileSource(file=tmp_path / "dark.csv", flux_w=1.0)) is None
    assert spectrum(RayfileSource(file=tmp_path / "grey.csv")) is None
    named = {"file": tmp_path / "grey.csv", "flux_w": 3.0, "spectrum": {"kind": "line", "wavelength_nm": 700.0}}
    both = spectrum(RayfilesSource(files=[{"file": tmp_path / "seen.csv", "flux_w": 1.0}, named]))
    red = both.wavelengths_nm > 650.0
    areas = [np.trapezoid(both.power_density[part], both.wavelengths_nm[part]) for part in (~red, red)]
    assert areas[1] / areas[0] == pytest.approx(3.0)
    unnamed = {"file": tmp_path / "grey.csv", "flux_w": 3.0}
    assert spectrum(RayfilesSource(files=[{"file": tmp_path / "seen.csv", "flux_w": 1.0}, unnamed])) is None


def test_a_table_in_the_header_of_a_file_is_its_spectrum(tmp_path):
    write_rayfile(tmp_path / "led.tm25ray", with_tables(rays(8)), "tm25")
    assert spectrum(RayfileSource(file=tmp_path / "led.tm25ray")).wavelengths_nm.tolist() == [430.0, 450.0, 470.0]


def test_chips_have_the_spectrum_of_all_by_their_power():
    chip = {"x_mm": 0.0, "y_mm": 0.0, "width_mm": 1.0, "height_mm": 1.0}
    colours = [{"kind": "line", "wavelength_nm": wave} for wave in (450.0, 633.0)]
    chips = [{**chip, "flux_w": flux, "spectrum": colour} for flux, colour in zip((1.0, 3.0), colours, strict=True)]
    both = spectrum(ChipsSource(chips=chips, spectrum=colours[0]))
    red = both.wavelengths_nm > 550.0
    areas = [np.trapezoid(both.power_density[part], both.wavelengths_nm[part]) for part in (~red, red)]
    assert areas[1] / areas[0] == pytest.approx(3.0)
    assert spectrum(ChipsSource(chips=[*chips, chip])) is None
