"""Throw, and what the far field says of flux code, direct ratios and spectrum: figures of light that is given."""

from dataclasses import replace

import numpy as np
import pytest
from test_photometry_record import LENS, SPEC, light, measured

from lensforge.light import far_field
from lensforge.light.luminaire_figures import throw_of
from lensforge.results import Metric
from lensforge.results.figure import facts_in
from lensforge.scene.lens import Lens

CONES = (0.75, 0.5, 0.25, 0.0)


@pytest.fixture(autouse=True)
def given(monkeypatch: pytest.MonkeyPatch) -> dict:
    given = {"light": light()}
    monkeypatch.setattr(far_field, "trace_exit_light", lambda *_, **__: given["light"])
    return given


def test_throw_is_where_the_peak_makes_a_quarter_of_a_lux() -> None:
    throw = throw_of(Metric(value=100.0, unit="cd", standard_error=4.0))
    assert (throw.value, throw.standard_error, throw.unit) == pytest.approx((20.0, 0.4, "m"))
    assert throw_of(Metric(value=0.0, unit="cd", standard_error=1.0)).standard_error == pytest.approx(2.0)
    assert throw_of(Metric(value=100.0, unit="cd")).standard_error is None


def test_throw_is_that_of_the_peak_and_unknown_without_lumens() -> None:
    photometry = measured()
    assert photometry.figures.throw == throw_of(photometry.peak_cd) and photometry.figures.throw.value > 10.0
    section = LENS.spec.source.changed(luminous_efficacy_lm_per_w=None)
    dark = Lens.double(*LENS.surfaces.values(), SPEC.changed(source=section), seed=5, accuracy="draft")
    assert measured(dark).figures.throw is None and measured(dark).per_1000_lm


def by_midpoints(values: np.ndarray, c_deg: np.ndarray, gamma_deg: np.ndarray) -> np.ndarray:
    """N1 to N3, and the direct ratio of room index 0.6, of the table of a file."""
    gamma = np.radians(np.arange(0.005, 90.0, 0.01))
    turn = np.radians(np.arange(0.5, 360.0, 1.0))
    rows = np.stack([np.interp(np.degrees(gamma), gamma_deg, row) for row in values])
    fine = np.stack([np.interp(np.degrees(turn), c_deg, column) for column in rows.T], axis=1) * np.sin(gamma)
    x = np.abs(np.cos(turn))[:, None] * np.tan(gamma) / 1.2
    y = np.abs(np.sin(turn))[:, None] * np.tan(gamma) / 1.2
    cones = [fine[:, np.cos(gamma) > cosine].sum() for cosine in CONES]
    landing = (fine * np.maximum(1.0 - x, 0.0) * np.maximum(1.0 - y, 0.0)).sum()
    return np.array([*cones[:3], landing]) / cones[3]


def test_shares_are_those_of_the_table_with_its_errors(given: dict) -> None:
    """The error of a share is by halves of the samples of rays, of which the table is the mean."""
    photometry = measured()
    *cones, down, lor = photometry.figures.flux_code
    shares = [*cones, photometry.figures.direct_ratios[0]]
    values = [share.value for share in shares]
    assert values == pytest.approx(by_midpoints(photometry.candela, photometry.c_deg, photometry.gamma_deg), rel=2e-4)
    assert (down.value, down.standard_error) == (1.0, 0.0) and lor == photometry.light_output_ratio
    intensity = given["light"].intensity
    samples = intensity.samples
    apart = []
    for bits in range(1, 16):
        parity = np.array([(k & bits).bit_count() % 2 for k in range(16)])
        by_half = []
        for half in (parity == 0, parity == 1):
            given["light"] = replace(light(), intensity=replace(intensity, samples=samples[half]))
            of_half = measured()
            by_half.append(by_midpoints(of_half.candela, of_half.c_deg, of_half.gamma_deg))
        apart.append(by_half[0] - by_half[1])
    errors = 0.5 * np.sqrt(np.mean(np.square(apart), axis=0))
    assert [share.standard_error for share in shares] == pytest.approx(errors, rel=0.01)


def test_screen_says_the_flux_code_in_per_cent() -> None:
    photometry = measured()
    facts = {fact.key: fact for fact in facts_in(photometry.figures)}
    code = [round(100.0 * share.value) for share in photometry.figures.flux_code]
    assert facts["flux_code"].value == " ".join(map(str, code)) and facts["throw"].unit == "m"


def test_spectrum_of_the_source_has_its_figures() -> None:
    assert measured().spectrum is None
    spectrum = {"kind": "table", "wavelength_nm": [430.0, 455.0, 560.0, 690.0], "weight": [0.1, 0.9, 0.7, 0.2]}
    source = {"spectrum": spectrum, "luminous_efficacy_lm_per_w": None}
    spec = SPEC.replace({f"source.{name}": value for name, value in source.items()})
    figures = measured(Lens.double(*LENS.surfaces.values(), spec, seed=5, accuracy="draft")).spectrum
    assert figures is not None and figures.rf == pytest.approx(80.693, abs=0.01)
