"""Numbers as text: as many digits as their standard errors carry, typographic, with the unit that a name implies."""

import pytest

from lensforge.results import Fact, Metric
from lensforge.results.numerals import anything, number, percent, quantity, size, square, unit_of


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.0123456, 0.00123, "0.0123 ± 0.0012"),
        (0.85, 0.000999, "0.8500 ± 0.0010"),  # the error is rounded first
        (-1.224e-4, 3.21e-5, "−0.000122 ± 0.000032"),
        (1234.5, 123.0, "1230 ± 120"),
        (12345.67, 1.23, "12\u2009346 ± 1.2"),  # five digits at most
        (0.99999999, 1e-6, "1.0000 ± 1\u2009×\u200910⁻⁶"),
        (-91.325674, 0.00012, "−91.326 ± 0.00012"),
        (3e-6, 4e-4, "0.00000 ± 0.00040"),
        (1.2345e-10, 1.2e-11, "1.23\u2009×\u200910⁻¹⁰ ± 1.2\u2009×\u200910⁻¹¹"),
        (1e-12, 3e-9, "0\u2009×\u200910⁰ ± 3.0\u2009×\u200910⁻⁹"),
        (0.123456789, None, "0.123457"),
    ],
)
def test_a_value_ends_where_its_error_does(value, error, text):
    assert str(Metric(value=value, standard_error=error)) == text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.12345678901, "mm", "0.1235 mm"),
        (75696.56795739077, "mm³", "75\u2009700 mm³"),
        (64.869, "°", "64.87°"),
        (82.7, "%", "82.7\u2009%"),
        (None, "mm", "–"),
    ],
)
def test_units_follow_by_their_own_gap(value, unit, text):
    assert quantity(value, unit, digits=4) == text


@pytest.mark.parametrize(
    ("path", "unit"),
    [
        ("form_error_nm.max", "nm"),
        ("normal_error_mrad.rms", "mrad"),
        ("volume_mm3", "mm³"),
        ("inner.area_mm2", "mm²"),
        ("inner.curvature.kappa_min_per_mm", "1/mm"),
        ("inner.best_fit_sphere.centre_mm", "mm"),
        ("inner.draft_deg.min", "°"),
        ("triangulation.chord_error_um", "µm"),
        ("seconds", "s"),
        ("files.lens.step.bytes", "B"),
        ("source.flux_w", "W"),
        ("source.luminous_efficacy_lm_per_w", "lm/W"),
        ("flux.detected", ""),
        ("table_error_nm.inner", "nm"),
        ("rays", ""),
        ("history.[0].nmse", ""),
        ("constraints.cavity_clearance_mm", "mm"),
        ("evaluate.filter_variance", "pixel²"),
        ("peak_cd", "cd"),
        ("files.lens.ies.lumens", "lm"),
        ("corners_located.edge_rms_px", "pixel"),
        ("source_lm", "lm"),
        ("exit_lm.standard_error", "lm"),
        ("lumens_per_watt", "lm/W"),
        ("turned_rad", "rad"),
        ("roads.[0].mean_lx", "lx"),
        ("roads.[0].uniformity_lx", ""),
        ("roads.[0].pole_spacing_m", "m"),
    ],
)
def test_units_follow_the_names(path, unit):
    assert unit_of(path.split(".")) == unit


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (4096, "4096"),
        (1048576, "1\u2009048\u2009576"),
        (-1048576, "−1\u2009048\u2009576"),
        (14.0, "14"),
        (-0.001, "−0.001"),
        (0.0052984912, "0.00529849"),
        (2.9976e-14, "2.9976\u2009×\u200910⁻¹⁴"),
        (1e9, "1\u2009×\u200910⁹"),
        (float("nan"), "–"),
        (None, "–"),
    ],
)
def test_numbers_read_well(value, text):
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (-0.002, 0.0031, "≤ 0.0031"),
        (-1e-9, 0.00042, "≤ 0.00042"),
        (0.002, 0.0031, "0.0020 ± 0.0031"),
        (0.0, 0.1, "0.00 ± 0.10"),
    ],
)
def test_a_mean_square_below_nothing_is_at_most_its_error(value: float, error: float, text: str) -> None:
    """Its record keeps the number; a change of such a square is shown as it is."""
    assert square(value, error) == text
    metric = Metric(value=value, standard_error=error)
    assert Fact.measured("fitted_nmse", "NMSE", metric, is_square=True).text == text
    assert Fact.measured("nmse", "NMSE", metric, is_square=True).plain()["value"] == value
    assert "≤" not in Fact.measured("nmse_change", "Change of NMSE", metric).text


def test_few_digits_of_a_large_number_need_no_exponent():
    assert [number(value, 3) for value in (12822.25, -1234.5, 987.6, 1.5e7 + 0.5)] == [
        "12\u2009800", "−1230", "988", "1.5\u2009×\u200910⁷",
    ]  # fmt: skip


def test_other_values_read_well():
    assert [anything(value) for value in (True, False, None, "text", 3)] == ["yes", "no", "–", "text", "3"]
    assert percent(0.88625, 4) == "88.62\u2009%"
    assert [size(count) for count in (12, 18494, 10137684)] == ["12\u2009B", "18.5\u2009kB", "10.1\u2009MB"]


def test_a_number_of_usual_size_is_no_power_of_ten_however_small_its_error() -> None:
    assert quantity(92.3005521712, "lm", 4.1e-7) == "92.301 ± 4.1\u2009×\u200910⁻⁷ lm"
    assert quantity(0.09230055, "", 4e-9) == "0.092301 ± 4\u2009×\u200910⁻⁹"
    assert quantity(1.569e-5, "", 2e-7) == "1.569\u2009×\u200910⁻⁵ ± 2.0\u2009×\u200910⁻⁷"
