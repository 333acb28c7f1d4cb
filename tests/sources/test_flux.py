"""One rule for W, lm and lm/W, for every combination of what spec and file state."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rayfile_samples import rays

import lensforge as lf
from lensforge.errors import InputError
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.rayfiles.ray_file_io import write_rayfile
from lensforge.sources.source_flux import OwnFlux, SourceFlux, joined_flux, settled_flux
from lensforge.spec.emitter_section import FluxSection

GREEN = lf.LineSpectrum(wavelength_nm=555.0)  # 683.002 lm/W
BLUE = lf.LineSpectrum(wavelength_nm=450.0)  # V = 0.038
INFRARED = lf.LineSpectrum(wavelength_nm=850.0)
FAR_RED = lf.LineSpectrum(wavelength_nm=730.0)  # 0.36 lm/W
LEAST = 683.002
ALONE = "its flux is known in lm alone"


def _square(**fields):
    """Power of the emitter and of its summary, lm/W that are shown, and the warnings."""
    spec = lf.SquareSource(side_mm=1.0, **fields)
    source = build_source(spec)
    summary = summarise(source, spec)
    assert summary.flux_w == source.flux_w
    assert source.sample(100, 0).flux.sum() == pytest.approx(source.flux_w, rel=1e-12)
    return source.flux_w, summary.lumens_per_watt, summary.warnings


@pytest.mark.parametrize(
    ("fields", "flux_w", "lumens_per_watt"),
    [
        ({}, 1.0, None),
        ({"flux_w": 2.0}, 2.0, None),
        ({"luminous_efficacy_lm_per_w": 300.0}, 1.0, 300.0),
        ({"flux_w": 2.0, "luminous_efficacy_lm_per_w": 300.0}, 2.0, 300.0),
        ({"flux_w": 2.0, "flux_lm": 500.0}, 2.0, 250.0),
        ({"flux_w": 2.0, "flux_lm": 500.0, "luminous_efficacy_lm_per_w": 251.0}, 2.0, 250.0),
        ({"flux_lm": 600.0, "luminous_efficacy_lm_per_w": 300.0}, 2.0, 300.0),
        ({"flux_lm": 600.0, "spectrum": GREEN}, 600.0 / LEAST, LEAST),
        ({"flux_lm": 600.0, "spectrum": BLUE}, 600.0 / (0.038 * LEAST), 0.038 * LEAST),
        ({"flux_lm": 0.1, "spectrum": FAR_RED}, 0.1 / (0.00052 * LEAST), 0.00052 * LEAST),
        ({"spectrum": BLUE}, 1.0, 0.038 * LEAST),
        ({"flux_w": 3.0, "spectrum": BLUE}, 3.0, 0.038 * LEAST),
        ({"flux_w": 3.0, "spectrum": INFRARED}, 3.0, None),
        ({"flux_w": 3.0, "spectrum": FAR_RED}, 3.0, None),
        ({"flux_w": 3.0, "spectrum": FAR_RED, "luminous_efficacy_lm_per_w": 0.36}, 3.0, 0.36),
        ({"flux_w": 2.0, "flux_lm": 52.0, "spectrum": BLUE}, 2.0, 26.0),
    ],
)
def test_power_and_efficacy_follow_from_what_the_spec_states(fields, flux_w, lumens_per_watt):
    found_w, found_lm_per_w, warnings = _square(**fields)
    assert found_w == pytest.approx(flux_w, rel=1e-12) and warnings == ()
    assert found_lm_per_w == (None if lumens_per_watt is None else pytest.approx(lumens_per_watt, rel=1e-12))


def test_lumens_alone_are_exact_and_their_watts_the_least_possible():
    flux_w, lumens_per_watt, warnings = _square(flux_lm=600.0)
    assert lumens_per_watt == LEAST and flux_w * lumens_per_watt == pytest.approx(600.0, rel=1e-15)
    assert len(warnings) == 1 and ALONE in warnings[0]
    _, _, warnings = _square(flux_lm=600.0, rotate_z_deg=10.0, position_mm=(0.1, 0.0, 0.0))
    assert sum(ALONE in warning for warning in warnings) == 1


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"flux_w": 1.0, "flux_lm": 684.0}, r"flux_lm = 684 of flux_w = 1 is 684 lm/W: no light has more than 683"),
        ({"flux_w": 1.0, "flux_lm": 300.0, "luminous_efficacy_lm_per_w": 310.0}, r"= 310, but flux_lm = 300 .* two of"),
        ({"flux_lm": 0.0}, r"flux_lm = 0"),
        ({"flux_lm": float("nan")}, r"flux_lm = nan"),
        ({"luminous_efficacy_lm_per_w": 684.0}, r"luminous_efficacy_lm_per_w = 684"),
        ({"flux_lm": 5.0, "spectrum": INFRARED}, r"flux of 5 lm, but its spectrum has no visible light; give flux_w"),
    ],
)
def test_what_no_light_can_be_is_one_line(fields, message):
    with pytest.raises(InputError, match=message) as refusal:
        _square(**fields)
    assert len(str(refusal.value).splitlines()) == 1


CHIP = {"width_mm": 0.5, "height_mm": 0.5, "y_mm": 0.0}


def _chips(first, second, **fields):
    chips = (lf.Chip(x_mm=-1.0, **CHIP, **first), lf.Chip(x_mm=1.0, **CHIP, **second))
    spec = lf.ChipsSource(chips=chips, **fields)
    source = build_source(spec)
    right = float((source.sample(2**14, 0).origins[:, 0] > 0.0).mean())
    summary = summarise(source, spec)
    return source.flux_w, summary.lumens_per_watt, pytest.approx(right, abs=1e-3), summary.warnings


@pytest.mark.parametrize(
    ("first", "second", "fields", "expected"),
    [
        ({}, {"flux_w": 3.0}, {}, (4.0, None, 0.75)),
        ({}, {"flux_w": 3.0}, {"flux_w": 1.0}, (1.0, None, 0.75)),
        ({"flux_lm": 100.0}, {"flux_lm": 300.0}, {"luminous_efficacy_lm_per_w": 200.0}, (2.0, 200.0, 0.75)),
        ({"flux_lm": 100.0}, {"flux_w": 1.5}, {"luminous_efficacy_lm_per_w": 200.0}, (2.0, 200.0, 0.75)),
        # each with its own efficacy: 100 and 300 lm/W, 1 W and 1 W
        ({"flux_lm": 100.0, "flux_w": 1.0}, {"flux_lm": 300.0, "flux_w": 1.0}, {}, (2.0, 200.0, 0.5)),
        ({"flux_lm": 100.0, "flux_w": 1.0}, {"flux_lm": 300.0, "flux_w": 1.0}, {"flux_lm": 40.0}, (0.2, 200.0, 0.5)),
        # lumens alone, and the power of all of them
        ({"flux_lm": 100.0}, {"flux_lm": 300.0}, {"flux_w": 2.0}, (2.0, None, 0.75)),
        ({"flux_lm": 100.0}, {"flux_lm": 300.0}, {"flux_w": 2.0, "flux_lm": 500.0}, (2.0, 250.0, 0.75)),
    ],
)
def test_chips_add_up_or_keep_their_ratio(first, second, fields, expected):
    flux_w, lumens_per_watt, right, warnings = _chips(first, second, **fields)
    assert warnings == () and flux_w == pytest.approx(expected[0], rel=1e-12) and right == expected[2]
    assert lumens_per_watt == (None if expected[1] is None else pytest.approx(expected[1], rel=1e-12))


def test_watts_of_one_chip_and_lumens_of_another_have_no_ratio():
    with pytest.raises(InputError, match=r"source\.chips\[1\]: flux known in lm alone, .* give its flux_w"):
        _chips({"flux_w": 1.0}, {"flux_lm": 300.0})
    parts = (settled_flux(FluxSection(flux_lm=5.0)), settled_flux(FluxSection(flux_w=5.0)))
    with pytest.raises(InputError, match=r"^blue: flux known"):
        joined_flux(FluxSection(), parts, names=("blue", "yellow"))


@pytest.mark.parametrize("blue", [{"flux_lm": 26.0}, {"flux_lm": 26.0, "flux_w": 1.0}])
def test_lumens_of_parts_stay_whatever_efficacy_of_the_whole_is_stated(blue, tmp_path):
    """Lumens of green and blue, each with its spectrum: 100 lm/W changes W alone, and the contradiction is told."""
    green, fields = {"flux_lm": 683.0, "spectrum": GREEN}, {"luminous_efficacy_lm_per_w": 100.0}
    blue = blue | {"spectrum": BLUE}
    flux_w, lumens_per_watt, right, warnings = _chips(green, blue, **fields)
    assert (flux_w, lumens_per_watt, right) == (pytest.approx(7.09), 100.0, pytest.approx(0.5, abs=1e-3))
    assert len(warnings) == 1 and "100 lm/W stated, its parts have 354" in warnings[0]
    assert _chips(green, blue)[0] == pytest.approx(2.0, rel=2e-3) and _chips(green, blue)[3] == ()
    write_rayfile(tmp_path / "led.tm25ray", _file(2.0, 500.0))
    for parts in ((green, blue), (green,)):
        files = tuple(lf.RayfilePart(file=tmp_path / "led.tm25ray", **part) for part in parts)
        spec = lf.RayfilesSource(files=files, **fields)
        source, lumens = build_source(spec), sum(part["flux_lm"] for part in parts)
        summary = summarise(source, spec)
        assert summary.flux_lm == pytest.approx(lumens, rel=1e-6) and summary.lumens_per_watt == 100.0
        assert source.rays.flux.sum() == pytest.approx(lumens / 100.0, rel=1e-6)
        assert any("100 lm/W stated, its parts have" in warning for warning in summary.warnings)


def test_watts_of_parts_stay_where_they_are_what_is_stated():
    flux_w, lumens_per_watt, *_, warnings = _chips(
        {"flux_w": 1.0, "spectrum": GREEN}, {"flux_w": 1.0, "spectrum": BLUE}, luminous_efficacy_lm_per_w=100.0
    )
    assert (flux_w, lumens_per_watt, len(warnings)) == (2.0, 100.0, 1)


def _table():
    return {"spectral_tables": [{"wavelength_nm": [549.0, 550.0, 551.0], "weight": [0.0, 1.0, 0.0]}]}


@pytest.fixture
def loaded(tmp_path: Path):
    """The summary of the ray file as a source with more fields."""

    def load(rayfile, name="led.tm25ray", **fields):
        path = tmp_path / name
        write_rayfile(path, rayfile)
        spec = lf.RayfileSource(file=path, **fields)
        source = build_source(spec)
        assert source.rays.flux.sum() == pytest.approx(source.flux_w, rel=1e-9)
        summary = summarise(source, spec)
        assert summary.files[0].flux_w == pytest.approx(summary.flux_w, rel=1e-12)
        return summary

    return load


def _file(flux_w, flux_lm, unit="W", **header):
    """A ray file whose rays add up to its total in ``unit``."""
    made = rays(unit=unit)
    factor = (flux_w if unit == "W" else flux_lm) / float(made.flux.sum())
    return replace(made, flux=made.flux * factor, header_flux_w=flux_w, header_flux_lm=flux_lm, header=header)


@pytest.mark.parametrize(
    ("rayfile", "fields", "flux_w", "lumens_per_watt"),
    [
        (_file(2.0, None), {}, 2.0, None),
        (_file(2.0, 500.0), {}, 2.0, 250.0),
        (_file(2.0, 500.0), {"flux_w": 1.0}, 1.0, 250.0),
        (_file(2.0, 500.0), {"flux_lm": 100.0}, 0.4, 250.0),
        (_file(2.0, 500.0), {"flux_lm": 100.0, "luminous_efficacy_lm_per_w": 200.0}, 0.5, 200.0),
        (_file(2.0, 500.0), {"flux_lm": 100.0, "spectrum": GREEN}, 100.0 / LEAST, LEAST),
        (_file(2.0, 500.0, "lm"), {}, 2.0, 250.0),
        (_file(None, 500.0, "lm"), {"flux_w": 1.0}, 1.0, None),
        (_file(None, 500.0, "lm"), {"luminous_efficacy_lm_per_w": 200.0}, 2.5, 200.0),
        (_file(None, 500.0, "lm"), {"spectrum": GREEN}, 500.0 / LEAST, LEAST),
        (_file(None, 500.0, "lm", **_table()), {}, 500.0 / 679.6, 679.6),
        (_file(None, 500.0, "lm", **_table()), {"flux_lm": 50.0}, 50.0 / 679.6, 679.6),
        (_file(2.0, None, **_table()), {}, 2.0, 679.6),
    ],
)
def test_a_ray_file_has_its_own_totals_and_spectrum(loaded, rayfile, fields, flux_w, lumens_per_watt):
    summary = loaded(rayfile, **fields)
    assert summary.flux_w == pytest.approx(flux_w, rel=1e-4)
    assert summary.lumens_per_watt == (None if lumens_per_watt is None else pytest.approx(lumens_per_watt, rel=1e-3))
    assert not any(ALONE in warning for warning in summary.warnings)


@pytest.mark.parametrize("fields", [{}, {"flux_lm": 40.0}])
def test_a_ray_file_in_lumens_alone_is_the_least_power_and_says_so(loaded, fields):
    summary = loaded(_file(None, 500.0, "lm"), **fields)
    assert summary.flux_lm == pytest.approx(fields.get("flux_lm", 500.0), rel=1e-6)
    assert summary.lumens_per_watt == LEAST
    assert sum(ALONE in warning for warning in summary.warnings) == 1


def test_two_files_keep_the_ratio_of_their_power_and_share_the_lumens(tmp_path):
    """Blue of 1 W and 20 lm, yellow of 3 W and 1380 lm: 350 lm/W together."""
    parts = []
    for name, flux_w, flux_lm in (("blue", 1.0, 20.0), ("yellow", 3.0, 1380.0)):
        write_rayfile(tmp_path / f"{name}.tm25ray", _file(flux_w, flux_lm))
        parts.append(lf.RayfilePart(file=tmp_path / f"{name}.tm25ray"))
    for fields, flux_w in (({}, 4.0), ({"flux_lm": 700.0}, 2.0), ({"flux_w": 2.0}, 2.0)):
        spec = lf.RayfilesSource(files=tuple(parts), **fields)
        summary = summarise(build_source(spec), spec)
        assert summary.flux_w == pytest.approx(flux_w, rel=1e-6)
        assert summary.lumens_per_watt == pytest.approx(350.0, rel=1e-6)
        assert [file.flux_w / summary.flux_w for file in summary.files] == pytest.approx([0.25, 0.75], rel=1e-6)


def test_given_rays_have_lumens_by_their_wavelengths():
    rows = np.column_stack([np.zeros((4, 3)), np.tile([0.0, 0.0, 1.0], (4, 1)), [1.0, 1.0, 1.0, 3.0]])
    spec = lf.RaySource(rows, flux_lm=100.0, wavelengths_nm=[450.0, 450.0, 450.0, 555.0])
    summary = summarise(build_source(spec), spec)
    assert summary.lumens_per_watt == pytest.approx(0.5 * (1.0 + 0.038) * LEAST, rel=1e-12)
    assert summary.flux_lm == pytest.approx(100.0, rel=1e-12)
    with pytest.raises(InputError, match="flux_w or flux_lm: of all rays"):
        lf.RaySource(rows[:, :6])
    assert build_source(lf.RaySource(rows[:, :6], flux_lm=LEAST)).flux_w == pytest.approx(1.0)


def test_a_ray_file_in_lumens_has_the_power_of_each_ray_by_its_wavelength(loaded):
    """Equal lumens at 450 and 555 nm: lm/W is the harmonic mean, for the blue rays carry nearly all of the power."""
    made = rays(count=2, unit="lm")
    halves = replace(made, flux=np.ones(2, np.float32), wavelengths_nm=np.array([450.0, 555.0]), header_flux_lm=2.0)
    summary = loaded(halves, "led.csv")
    assert summary.lumens_per_watt == pytest.approx(LEAST * 2.0 / (1.0 + 1.0 / 0.038), rel=1e-5)
    assert summary.flux_lm == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize(
    ("lumens", "efficacy"),
    [(1e-6, 1e-6), (0.99e-6, None), (683.002, 683.002), (683.002 * 1.00009, 683.002), (683.002 * 1.0002, None)],
)
def test_both_totals_of_a_file_have_a_ratio_that_light_can_have(lumens: float, efficacy: float | None) -> None:
    flux = settled_flux(FluxSection(), own_flux=OwnFlux(1.0, lumens))
    assert flux.efficacy == (None if efficacy is None else pytest.approx(efficacy, rel=1e-12))
    assert flux.flux_w == 1.0 and flux.in_lumens and len(flux.warnings) == (efficacy is None)
    if efficacy is None:
        assert ("no light has more than 683" if lumens > 1.0 else "that is no visible light") in flux.warnings[0]


def test_parts_are_joined_by_their_sums_and_their_warnings_are_told_once() -> None:
    parts = [SourceFlux(1.0, 100.0, warnings=("a", "b")), SourceFlux(3.0, 300.0, True, warnings=("b",))]
    flux = joined_flux(FluxSection(), parts)
    assert (flux.flux_w, flux.efficacy, flux.in_lumens, flux.warnings) == (4.0, 250.0, True, ("a", "b"))
    flux = joined_flux(FluxSection(), [parts[0], SourceFlux(3.0)])
    assert (flux.flux_w, flux.efficacy, flux.in_lumens) == (4.0, None, False)
    assert (
        joined_flux(FluxSection(), [parts[0]], 120.0).in_lumens
        and joined_flux(FluxSection(flux_lm=5.0), parts).in_lumens
    )
