"""Light at which the index of the lens is not known: extrapolated, taken at the range's end, or refused; counted."""

from dataclasses import replace

import numpy as np
import pytest
from extrapolation import difference_by_abbe_number, differences
from rayfile_samples import rays
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS, by_abbe_number
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.dispersion import index_of_spectrum
from lensforge.sources.rayfiles import write_rayfile
from lensforge.sources.source_spectrum import Spectrum
from lensforge.sources.source_summary import SourceSummary

PMMA = MATERIALS["PMMA"]


def emitter(source, material="PMMA"):
    spec = small_spec(source=source, lens__material=material)
    built = build_source(spec.source, spec.lens.dispersion)
    return built, summarise(built, spec.source)


def saved(folder, waves, flux=None, name="led.tm25ray"):
    count = len(waves)
    flux = np.ones(count) if flux is None else np.asarray(flux)
    few = replace(rays(count), wavelengths_nm=np.asarray(waves, dtype=np.float32), flux=flux.astype(np.float32))
    write_rayfile(folder / name, replace(few, header_flux_w=float(flux.sum())), "tm25")
    return {"kind": "rayfile", "file": str(folder / name)}


def test_one_ray_in_400_outside_the_range_does_not_refuse_the_file(tmp_path):
    """The ray of 371.098 nm has the index at 378 nm, 10 % below the 420 nm to which the index was measured."""
    waves = np.full(400, 450.0)
    waves[17], waves[30:34] = 371.098, 400.0
    source, summary = emitter(saved(tmp_path, waves))
    indices = source.sample(400, 0).refractive_indices
    assert indices[17] == pytest.approx(float(PMMA.dispersion.index(np.array([378.0]))[0]), abs=1e-9)
    np.testing.assert_allclose(indices[30:34], PMMA.index_at(400.0), atol=1e-7)
    assert summary.clamped_index_share == pytest.approx(1 / 400)
    assert summary.extrapolated_index_share == pytest.approx(4 / 400)
    assert summary.wavelengths_nm == pytest.approx((371.098, 450.0))
    (words,) = [warning for warning in summary.warnings if "PMMA" in warning]
    assert words.startswith("0.25 % of the flux is outside 378 to 1782 nm, where the index of PMMA is known")
    assert summary.files[0].clamped_index_share == summary.clamped_index_share
    assert words in summary.files[0].warnings
    assert SourceSummary.model_validate_json(summary.model_dump_json()) == summary


def test_the_share_is_that_of_all_files_by_their_power(tmp_path):
    blue = saved(tmp_path, [371.0, *[450.0] * 199], name="blue")["file"]
    red = saved(tmp_path, [600.0] * 50, name="red")["file"]
    files = [{"file": blue, "flux_w": 1.0}, {"file": red, "flux_w": 4.0}]
    _, summary = emitter({"kind": "rayfiles", "files": files})
    assert summary.clamped_index_share == pytest.approx(0.2 / 200)
    assert [file.clamped_index_share for file in summary.files] == [pytest.approx(1 / 200), 0.0]
    assert any(warning.startswith("blue: 0.5 % of the flux is outside") for warning in summary.warnings)


def test_a_ray_without_a_usable_wavelength_has_the_mean_one_and_is_counted(tmp_path):
    waves = np.full(200, 450.0)
    waves[100:], waves[5] = 550.0, np.nan
    source, summary = emitter(saved(tmp_path, waves))
    mean = (450.0 * 99 + 550.0 * 100) / 199
    assert source.sample(200, 0).refractive_indices[5] == pytest.approx(PMMA.index_at(mean), abs=1e-7)
    assert summary.clamped_index_share == pytest.approx(1 / 200)
    assert any("no usable wavelength" in warning for warning in summary.warnings)
    with pytest.raises(InputError, match=r"led\.tm25ray: no ray has a usable wavelength"):
        emitter(saved(tmp_path, [np.nan] * 20))


def test_the_tail_of_a_spectrum_is_counted_exactly():
    """Triangle 360-460-560 nm: below 378 nm is (18/100)^2 / 2 of it, below 420 nm (60/100)^2 / 2; closed forms."""
    spectrum = Spectrum(np.array([360.0, 460.0, 560.0]), np.array([0.0, 1.0, 0.0]))
    for wave, share in ((300.0, 0.0), (378.0, 0.0162), (420.0, 0.18), (460.0, 0.5), (510.0, 0.875), (700.0, 1.0)):
        assert spectrum.share_up_to(wave) == pytest.approx(share, abs=1e-14)
    with pytest.raises(InputError, match=r"spectrum: wavelengths from 360 to 560 nm;.* 1\.62 % of the flux is outside"):
        index_of_spectrum(spectrum, PMMA)
    narrow = Spectrum(np.array([370.0, 470.0, 570.0]), np.array([0.0, 1.0, 0.0]))
    found = index_of_spectrum(narrow, PMMA)
    assert found.clamped_share == pytest.approx(0.08**2 / 2)
    assert found.extrapolated_share == pytest.approx((0.5**2 - 0.08**2) / 2)
    assert found.wavelengths_nm == (370.0, 570.0)
    line = index_of_spectrum(Spectrum(np.array([400.0]), np.ones(1)), PMMA)
    assert (line.extrapolated_share, line.clamped_share) == (1.0, 0.0)
    end = index_of_spectrum(Spectrum(np.array([378.0]), np.ones(1)), PMMA)
    assert (end.extrapolated_share, end.clamped_share) == (1.0, 0.0)


def test_an_analytic_source_with_a_tail_is_traced_and_warned_of():
    table = {"kind": "table", "wavelength_nm": [370.0, 470.0, 570.0], "weight": [0.0, 1.0, 0.0]}
    source, summary = emitter({"kind": "square", "side_mm": 1.0, "spectrum": table})
    assert summary.clamped_index_share == pytest.approx(0.0032)
    assert [warning.split(" of the flux")[0] for warning in summary.warnings] == ["12.2 %", "0.32 %"]
    indices = source.sample(10_000, 3).refractive_indices
    limit = float(PMMA.dispersion.index(np.array([378.0]))[0])
    assert indices.max() == pytest.approx(limit, abs=1e-12)
    assert np.count_nonzero(indices == indices.max()) == pytest.approx(32, abs=1)
    wide = {**table, "wavelength_nm": [300.0, 470.0, 570.0]}
    with pytest.raises(InputError, match="of the flux is outside"):
        emitter({"kind": "square", "side_mm": 1.0, "spectrum": wide})


def test_the_stated_errors_are_those_of_the_benchmark():
    by_formula = [material for material in MATERIALS.values() if material.dispersion.name != "cauchy"]
    for material in by_formula:
        worst = max(difference for _, _, difference, _ in differences(material))
        assert 0.6 * material.extrapolation_error < worst < 1.02 * material.extrapolation_error, material.name
    abbe = max(difference_by_abbe_number(material) for material in by_formula)
    assert 0.7 * 0.005 < abbe < 0.005 == by_abbe_number(1.5, 50.0).extrapolation_error


def test_the_nearest_index_continues_the_trusted_one():
    waves = np.array([200.0, 378.0, 420.0, 900.0, 1782.0, 9000.0])
    found = PMMA.nearest_index(waves)
    np.testing.assert_array_equal(found[1:5], PMMA.index(waves[1:5]))
    assert (found[0], found[5]) == (found[1], found[4])
    with pytest.raises(InputError, match="known from 420 to 1620 nm, and extrapolated from 378 to 1782 nm"):
        PMMA.index(np.array([371.098]))
