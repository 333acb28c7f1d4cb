"""Light at which the index of the lens is not known: extrapolated, taken at the range's end, or refused; counted."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from rayfile_samples import rays
from scenes import small_spec
from scipy.integrate import quad

from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS
from lensforge.optics.media import Medium
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.dispersion import coloured, index_of_spectrum, index_warnings
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.rayfiles.ray_file_io import write_rayfile
from lensforge.sources.source_spectrum import Spectrum, WavelengthDraw, usable_wavelengths
from lensforge.sources.source_summary import IndexRange

PMMA = MATERIALS["PMMA"]
EXAMPLES = Path(__file__).parents[2] / "examples"


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
    assert source.sample(200, 0).wavelengths_nm[5] == pytest.approx(mean, abs=1e-3)
    assert summary.clamped_index_share == pytest.approx(1 / 200)
    assert any("no usable wavelength" in warning for warning in summary.warnings)
    with pytest.raises(InputError, match=r"led\.tm25ray: no ray has a usable wavelength"):
        emitter(saved(tmp_path, [np.nan] * 20))


def test_what_a_file_says_of_itself_stands_beside_what_is_said_of_the_index(tmp_path):
    """A photometric file whose lamps have half of its lumens, and blue light at which PMMA was not measured."""
    text = (EXAMPLES / "street_light.ies").read_text(encoding="ascii")
    assert "\n1 1000 1 91 73 1 2" in text
    (tmp_path / "half.ies").write_text(text.replace("\n1 1000 1", "\n1 500 1"), encoding="ascii")
    intensity = {"kind": "photometric", "file": str(tmp_path / "half.ies")}
    blue = {"kind": "table", "wavelength_nm": [390.0, 400.0, 500.0], "weight": [1.0, 1.0, 0.0]}
    size = {"kind": "rectangle", "width_mm": 1.0, "height_mm": 0.6, "position_mm": [0.1, 0.0, 0.0]}
    _, summary = emitter({**size, "intensity": intensity, "spectrum": blue})
    first, second = summary.warnings
    assert first == "half.ies: its light has 1000 lm, its lamps only 500 lm: check its factors"
    assert "where the index of PMMA was measured" in second


@pytest.mark.parametrize("part", [slice(0, 12), slice(5, 12)])
def test_light_is_counted_by_what_is_known_at_its_wavelength_ends_included(part) -> None:
    inside = set(range(*part.indices(12)))
    count, flux = len(inside), FLUX[part]
    rays = RayBundle(np.zeros((count, 3)), np.tile([0.0, 0.0, 1.0], (count, 1)), flux).with_wavelengths(WAVES[part])
    bundle, account = coloured(rays, PMMA, "lamp")
    assert account.clamped_index_share == pytest.approx(FLUX[[*({0, 2, 9, 10, 11} & inside)]].sum() / flux.sum())
    assert account.extrapolated_index_share == pytest.approx(FLUX[[*({1, 3, 7, 8} & inside)]].sum() / flux.sum())
    usable = sorted(set(range(10)) & inside)
    assert account.wavelengths_nm == (WAVES[usable].min(), 1782.1)
    assert bundle.wavelengths_nm[-1] == pytest.approx(FLUX[usable] @ WAVES[usable] / FLUX[usable].sum())
    with pytest.raises(InputError, match="lamp: no ray has a usable wavelength"):
        coloured(rays.with_wavelengths(np.full(count, np.nan)), PMMA, "lamp")


WAVES = np.array([300.0, 378.0, 377.9, 419.9, 420.0, 500.0, 1620.0, 1620.1, 1782.0, 1782.1, np.nan, 0.5])
FLUX = 2.0 ** -np.arange(12.0)
FLUX[[0, 2, 9, 10, 11]] *= 1e-3  # outside: a hundredth of the flux at most may be


@pytest.mark.parametrize(("share", "refused"), [(0.01, False), (0.0101, True)])
def test_one_per_cent_may_have_the_index_at_the_end_of_the_range(share: float, refused: bool) -> None:
    flux, waves = np.array([share, 0.2, 0.8 - share]), np.array([1800.0, 400.0, 600.0])
    rays = RayBundle(np.zeros((3, 3)), np.tile([0.0, 0.0, 1.0], (3, 1)), flux).with_wavelengths(waves)
    if refused:
        with pytest.raises(InputError, match=r"1\.01 % of the flux is outside, at most 1 % may be"):
            coloured(rays, PMMA, "lamp")
        return
    bundle, known = coloured(rays, PMMA, "lamp")
    assert known.clamped_index_share == pytest.approx(0.01) and known.extrapolated_index_share == pytest.approx(0.2)
    assert known.wavelengths_nm == (400.0, 1800.0)
    indices = [PMMA.index_at(400.0), float(PMMA.nearest_index(np.array([1800.0]))[0])]
    assert list(known.refractive_indices) == pytest.approx(indices)
    medium = Medium(1.49, 0.01, PMMA)
    assert medium.index(bundle.waves).tolist() == pytest.approx([indices[1], indices[0], PMMA.index_at(600.0)])
    assert bundle.wavelengths_nm.tolist() == waves.tolist() and bundle.flux.tolist() == flux.tolist()
    assert PMMA.absorption is None and medium.absorption(bundle.waves).tolist() == [0.01]


@pytest.mark.parametrize(
    ("extrapolated", "clamped", "messages"),
    [(0.01, 0.0, []), (0.0101, 0.0, ["1.01 %"]), (0.5, 1e-9, ["50 %", "1e-07 %"])],
)
def test_more_than_one_per_cent_is_mentioned_and_any_light_beyond_what_is_known(
    extrapolated, clamped, messages
) -> None:
    index_range = IndexRange(extrapolated_index_share=extrapolated, clamped_index_share=clamped)
    assert [warning.split(" of the flux")[0] for warning in index_warnings(index_range, PMMA)] == messages


@pytest.mark.parametrize(
    ("waves", "density", "ends"),
    [
        ([390.0, 430.0, 500.0, 600.0, 700.0], [0.0, 0.0, 1.0, 0.0, 0.0], (430.0, 600.0)),
        ([430.0, 500.0, 600.0], [1.0, 2.0, 1.0], (430.0, 600.0)),
        ([400.0, 430.0, 500.0, 600.0], [0.0, 1.0, 2.0, 0.0], (400.0, 600.0)),
        ([1500.0, 1600.0, 1640.0], [0.0, 1.0, 0.0], (1500.0, 1640.0)),
        ([360.0, 380.0, 500.0, 1600.0, 1800.0], [0.0, 0.05, 2.0, 0.2, 0.0], (360.0, 1800.0)),
    ],
)
def test_a_spectrum_ends_where_its_light_ends_and_is_counted_exactly(waves, density, ends) -> None:
    index_range = index_of_spectrum(Spectrum(np.array(waves), np.array(density)), PMMA)
    assert index_range.wavelengths_nm == ends

    def light(low: float, high: float) -> float:
        edges = [low, *[wave for wave in waves if low < wave < high], high]
        at = pairwise(edges)
        return sum(quad(lambda wave: np.interp(wave, waves, density, 0.0, 0.0), *part)[0] for part in at)

    whole = light(360.0, 1800.0)
    clamped = light(360.0, 378.0) + light(1782.0, 1800.0)
    extrapolated = light(378.0, 420.0) + light(1620.0, 1782.0)
    assert index_range.clamped_index_share == pytest.approx(clamped / whole, abs=1e-12)
    assert index_range.extrapolated_index_share == pytest.approx(extrapolated / whole, abs=1e-12)


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
