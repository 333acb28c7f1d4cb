"""Light at which the index of the lens is not known: extrapolated, taken at the range's end, or refused; counted."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from extrapolation import difference_by_abbe_number, differences
from rayfile_samples import rays
from scenes import small_spec
from scipy.integrate import quad

from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS, by_abbe_number
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.dispersion import (
    IndexAccount,
    IndexRange,
    dispersed,
    in_material,
    index_of_spectrum,
    known_or,  # fmt: skip
)
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.rayfiles.ray_file_io import write_rayfile
from lensforge.sources.source_spectrum import Spectrum, WavelengthDraw, usable_wavelengths
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
