import numpy as np
import pytest
from result_folders import CONTENT

from lensforge.report.numerals import anything, number, percent, size
from lensforge.report.tables import rows
from lensforge.report.units import unit_of


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
        ("inner.draft_deg.area_fraction_below_0.5", ""),
        ("mesh.chord_error_um", "µm"),
        ("seconds", "s"),
        ("cast_seconds", "s"),
        ("files.lens.step.bytes", "B"),
        ("source.flux_w", "W"),
        ("source.luminous_efficacy_lm_per_w", "lm/W"),
        ("flux.detected", ""),
        ("table_error_nm.inner", "nm"),
        ("rays", ""),
        ("history.[0].nmse", ""),
        ("constraints.g1_mm", "mm"),
        ("evaluate.filter_variance", "pixel²"),
        ("referee.rate", "1/s"),
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


def test_few_digits_of_a_large_number_need_no_exponent():
    assert [number(value, 3) for value in (12822.25, -1234.5, 987.6, 1.5e7 + 0.5)] == [
        "12\u2009800", "−1230", "988", "1.5\u2009×\u200910⁷",
    ]  # fmt: skip


def test_other_values_read_well():
    assert [anything(value) for value in (True, False, None, "text", 3)] == ["yes", "no", "–", "text", "3"]
    assert percent(0.88625, 2) == "88.62\u2009%"
    assert [size(count) for count in (12, 18494, 10137684)] == ["12\u2009B", "18.5\u2009kB", "10.1\u2009MB"]


def leaves(content):
    if isinstance(content, dict):
        return sum(map(leaves, content.values()))
    if isinstance(content, list):
        return sum(map(leaves, content))
    return 1


@pytest.mark.parametrize("stage", CONTENT)
def test_every_value_of_every_file_is_in_its_table(stage):
    content = {key: value for key, value in CONTENT[stage].items() if key != "gates"}
    table = rows(CONTENT[stage], without=("gates",))
    texts = [text for row in table for text in row.value.split("  ")]
    assert len(texts) == leaves(content)
    assert len({row.path for row in table}) == len(table)


def test_many_numbers_become_a_block_with_one_unit():
    (row,) = rows({"weights_mm": np.linspace(0.0, 1.0, 50).tolist()})
    assert row.block
    assert row.unit == "mm"
    assert len(row.value.split("  ")) == 50


def test_text_and_nothing_have_no_unit():
    assert [row.unit for row in rows({"uniform_mm": None, "radius_mm_note": "any", "side_mm": 2.0})] == ["", "", "mm"]
