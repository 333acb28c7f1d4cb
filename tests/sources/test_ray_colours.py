"""Colours of rays: of chips with spectra of their own, of ray files, by wavelength, and what cannot be used."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rayfile_samples import rays
from scenes import small_spec

import lensforge as lf
from lensforge.errors import InputError
from lensforge.optics.colorimetry import tristimulus_at, tristimulus_of
from lensforge.optics.material import MATERIALS
from lensforge.proof.proof_inputs import independent_rays
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.rayfiles.ray_file_io import write_rayfile
from lensforge.sources.source_spectrum import spectrum_of

RED, BLUE = lf.GaussianSpectrum(peak_nm=630.0, fwhm_nm=20.0), lf.GaussianSpectrum(peak_nm=455.0, fwhm_nm=24.0)
INFRARED = lf.LineSpectrum(wavelength_nm=940.0)


def chips(*spectra: Any, **fields: Any) -> lf.ChipsSource:
    """Chips of 1 mm side by side along x."""
    row = [
        lf.Chip(x_mm=1.2 * k, y_mm=0.0, width_mm=1.0, height_mm=1.0, spectrum=spectrum)
        for k, spectrum in enumerate(spectra)
    ]
    return lf.ChipsSource(chips=row, **fields)


def xyz(spectrum: Any) -> np.ndarray:
    table = spectrum_of(spectrum)
    return tristimulus_of(table.wavelengths_nm, table.power_density)


def of(bundle: RayBundle) -> np.ndarray:
    assert bundle.tristimulus is not None
    return bundle.tristimulus


def test_a_gaussian_spectrum_has_its_width_and_halves() -> None:
    spectrum = spectrum_of(lf.GaussianSpectrum(peak_nm=530.0, fwhm_nm=30.0))
    assert spectrum.share_up_to(530.0) == pytest.approx(0.5)
    assert np.interp([515.0, 545.0], spectrum.wavelengths_nm, spectrum.power_density) == pytest.approx(
        [0.5, 0.5], abs=1e-3
    )
    assert spectrum.share_up_to(545.0) - spectrum.share_up_to(515.0) == pytest.approx(
        0.7610, abs=1e-3
    )  # erf(sqrt(ln 2))


def test_rays_of_a_chip_have_its_colour() -> None:
    bundle = build_source(chips(RED, BLUE, spectrum=RED), coloured=True).sample(512, 3)
    blue = bundle.origins[:, 0] > 0.6
    assert 0.45 < blue.mean() < 0.55
    np.testing.assert_allclose(of(bundle), np.where(blue[:, None], xyz(BLUE), xyz(RED)))


def test_a_mirror_image_of_other_colours_is_no_symmetry() -> None:
    def symmetry(*spectra: Any) -> str:
        source = chips(*spectra)
        moved = [chip.model_copy(update={"x_mm": chip.x_mm - 0.6 * (len(spectra) - 1)}) for chip in source.chips]
        return build_source(source.model_copy(update={"chips": tuple(moved)})).symmetry

    assert symmetry(RED, RED) == symmetry(None, None) == symmetry(RED, BLUE, RED) == "rectangle"
    assert symmetry(RED, BLUE) == symmetry(RED, RED, BLUE) == "mirror_y"


def test_chips_of_lumens_have_the_watts_of_their_own_spectra() -> None:
    lumens = (50.0, 90.0)
    pairs = zip(chips(RED, BLUE).chips, lumens, strict=True)
    lit = lf.ChipsSource(chips=[chip.model_copy(update={"flux_lm": flux}) for chip, flux in pairs])
    built = build_source(lit)
    assert built.flux_w == pytest.approx(50.0 / xyz(RED)[1] + 90.0 / xyz(BLUE)[1], rel=5e-3)
    assert summarise(built, lit).flux_lm == pytest.approx(140.0)


@pytest.mark.parametrize("proof", [False, True])
def test_rays_of_chips_disperse_by_the_spectra_of_their_own(proof: bool) -> None:
    """Of an LED that is turned and shifted: x of its own frame is y of the lens."""
    turned = chips(RED, BLUE, rotate_z_deg=90.0, position_mm=(0.3, -2.0, 0.0))
    spec = small_spec(source=turned.model_dump(), lens__material="PMMA")
    source = build_source(spec.source, spec.lens.dispersion, coloured=True)
    bundle = independent_rays(spec, source, 2**12, 5) if proof else source.sample(2**12, 5)
    assert bundle.wavelengths_nm is not None
    across = bundle.origins[:, 1] + 2.0
    for on_chip, spectrum in ((across < 0.6, RED), (across > 0.6, BLUE)):
        waves, sigma = bundle.wavelengths_nm[on_chip], spectrum.fwhm_nm / 2.3548
        assert waves.mean() == pytest.approx(spectrum.peak_nm, abs=4.0 * sigma / np.sqrt(on_chip.sum()))
        assert waves.std() == pytest.approx(sigma, rel=0.06)
    if not proof:
        np.testing.assert_array_equal(of(bundle), tristimulus_at(bundle.wavelengths_nm))
    low, high = summarise(source, spec.source).wavelengths_nm or (0.0, 0.0)
    assert (low < 440.0, high > 640.0) == (True, True)


def test_what_is_beyond_the_known_index_counts_by_the_flux_of_each_chip() -> None:
    """Chips of 3 W and 1 W, the second with more light where the index is extrapolated."""
    pmma = MATERIALS["PMMA"]
    spectra = lf.GaussianSpectrum(peak_nm=630.0, fwhm_nm=100.0), lf.GaussianSpectrum(peak_nm=415.0, fwhm_nm=24.0)
    fluxes = (3.0, 1.0)
    lit = [chip.model_copy(update={"flux_w": flux}) for chip, flux in zip(chips(*spectra).chips, fluxes, strict=True)]
    alone = [build_source(chips(spectrum), pmma).index_range for spectrum in spectra]
    both = build_source(lf.ChipsSource(chips=lit), pmma).index_range
    shares = [account.extrapolated_index_share for account in alone]
    assert shares[0] < 0.1 * shares[1] and shares[1] > 0.05
    assert both.extrapolated_index_share == pytest.approx((3.0 * shares[0] + shares[1]) / 4.0)
    assert both.clamped_index_share == pytest.approx(
        (3.0 * alone[0].clamped_index_share + alone[1].clamped_index_share) / 4.0
    )


@pytest.mark.parametrize("material", [None, "PMMA"])
def test_several_ray_files_have_a_colour_each(material: str | None, tmp_path: Path) -> None:
    """The mean over many rays is that of the parts by their power, dispersed or not; a file's own spectrum decides."""
    for number, name in enumerate(("blue", "red")):
        write_rayfile(tmp_path / f"{name}.tm25ray", rays(4000, seed=number), "tm25")
    parts = [
        lf.RayfilePart(file=tmp_path / f"{name}.tm25ray", flux_w=power, spectrum=spectrum)
        for name, power, spectrum in (("blue", 3.0, BLUE), ("red", 1.0, None))
    ]
    spec = lf.RayfilesSource(files=parts, spectrum=RED)
    source = build_source(spec, material and MATERIALS[material], coloured=True)
    bundle = source.sample(8000, 1)
    mean = bundle.flux @ of(bundle) / bundle.flux.sum()
    np.testing.assert_allclose(mean, 0.75 * xyz(BLUE) + 0.25 * xyz(RED), rtol=1e-9 if material is None else 0.02)


def test_rays_of_a_file_have_the_colours_of_their_own_wavelengths(tmp_path: Path) -> None:
    written = rays(50, wavelengths="each")
    write_rayfile(tmp_path / "each.tm25ray", written, "tm25")
    bundle = build_source(lf.RayfileSource(file=tmp_path / "each.tm25ray"), coloured=True).sample(50, 1)
    assert bundle.wavelengths_nm is None, "a lens of one index does not part them"
    np.testing.assert_allclose(of(bundle), tristimulus_at(np.asarray(written.wavelengths_nm, dtype=np.float64)))


def test_colours_stay_with_their_rays() -> None:
    bundle = build_source(chips(RED, BLUE), coloured=True).sample(64, 1)
    some = np.array([5, 2, 60])
    np.testing.assert_array_equal(of(bundle.take(some)), of(bundle)[some])
    again = RayBundle.joined([bundle.take(slice(0, 9)), bundle.take(slice(9, 64))])
    np.testing.assert_array_equal(of(again), of(bundle))
    assert build_source(chips(RED, BLUE)).sample(64, 1).tristimulus is None, "nobody asked"


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (lf.SquareSource(side_mm=1.0), "source: its colour is not known; give its spectrum"),
        (lf.SquareSource(side_mm=1.0, spectrum=INFRARED), "source.spectrum: from 940 to 940 nm, no light that is seen"),
        (chips(RED, INFRARED), r"source.chips\[1\].spectrum: from 940"),
        (chips(RED, None), r"source.chips\[1\]: no spectrum, as other chips have"),
    ],
)
def test_colour_without_a_visible_spectrum_is_refused(source: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_source(source, coloured=True)


@pytest.mark.parametrize(
    ("waves", "message"), [(None, "its colour is not known"), (940.0, "from 930 to 950 nm, no light that is seen")]
)
def test_ray_files_without_a_visible_spectrum_are_refused(waves: float | None, message: str, tmp_path: Path) -> None:
    written = rays(20)
    if waves is not None:
        written = replace(written, wavelengths_nm=np.linspace(waves - 10.0, waves + 10.0, 20, dtype=np.float32))
    write_rayfile(tmp_path / "led.tm25ray", written, "tm25")
    with pytest.raises(InputError, match=message) as caught:
        build_source(lf.RayfileSource(file=tmp_path / "led.tm25ray"), coloured=True)
    assert "\n" not in str(caught.value)
