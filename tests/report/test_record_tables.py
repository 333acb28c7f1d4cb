import json

import numpy as np
import pytest
from part_files import whole_results

from lensforge.report.numerals import anything, number, percent, size, unit_of
from lensforge.report.tables import rows
from lensforge.results import Metric
from lensforge.spec import ArrayTarget


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
        ("inner.draft_deg.area_fraction_below_half", ""),
        ("triangulation.chord_error_um", "µm"),
        ("seconds", "s"),
        ("cast_seconds", "s"),
        ("files.lens.step.bytes", "B"),
        ("source.flux_w", "W"),
        ("source.luminous_efficacy_lm_per_w", "lm/W"),
        ("flux.detected", ""),
        ("table_error_nm.inner", "nm"),
        ("rays", ""),
        ("history.[0].nmse", ""),
        ("constraints.cavity_clearance_mm", "mm"),
        ("evaluate.filter_variance", "pixel²"),
        ("plain_cast.rate", "1/s"),
        ("peak_cd", "cd"),
        ("files.lens.ies.lumens", "lm"),
        ("corners_located.edge_rms_px", "pixel"),
        ("source_lm", "lm"),
        ("exit_lm.standard_error", "lm"),
        ("lumens_per_watt", "lm/W"),
        ("peak_w_m2", "W/m²"),
        ("turned_rad", "rad"),
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
    """How many values there are; a metric and an empty list are one each."""
    if isinstance(content, dict):
        return 1 if content.keys() == {"value", "unit", "standard_error"} else sum(map(leaves, content.values()))
    if isinstance(content, list):
        return sum(map(leaves, content)) or 1
    return 1


RESULTS = whole_results().found


@pytest.mark.parametrize("stem", RESULTS)
def test_every_value_of_every_record_is_in_its_table(stem):
    content = {key: value for key, value in RESULTS[stem].plain().items() if key not in ("criteria", "verdicts")}
    table = rows(RESULTS[stem].plain(), without=("criteria", "verdicts"))
    texts = [text for row in table for text in row.value.split("  ")]
    assert len(texts) == leaves(content)
    assert len({row.path for row in table}) == len(table)


@pytest.mark.parametrize("stem", RESULTS)
def test_a_table_holds_what_the_json_file_holds_and_no_more(stem):
    result = RESULTS[stem]
    written = json.loads(result.contents(stem)[f"{stem}.json"])
    for key in ("arrays_sha256", "content_sha256"):  # of the files: no numbers of the result
        written.pop(key, None)
    assert {"schema": written["schema"], **result.plain()} == written


def test_a_metric_is_one_row_in_its_own_unit():
    (row,) = rows({"exit_w": Metric(value=0.75, unit="lm", standard_error=0.0025).model_dump()})
    assert (row.path, row.value, row.unit) == ("exit_w", "0.7500 ± 0.0025", "lm")
    (row,) = rows({"hit_mm": Metric(value=0.5).model_dump()})
    assert (row.path, row.value, row.unit) == ("hit_mm", "0.5", "mm")


def test_arrays_of_a_spec_are_told_apart_and_not_written_out():
    target = {"distance_mm": 100.0, "receiver_mm": 100.0, "width_mm": 50.0}
    first, second = (rows(ArrayTarget(values=np.eye(40) + each, **target).model_dump()) for each in (0.0, 1.0))
    (one,), (other,) = ([row.value for row in table if row.path == "values"] for table in (first, second))
    assert one.startswith("40 × 40 numbers")
    assert len(one) < 60
    assert one != other


def test_many_numbers_become_a_block_with_one_unit():
    (row,) = rows({"weights_mm": np.linspace(0.0, 1.0, 50).tolist()})
    assert row.block
    assert row.unit == "mm"
    assert len(row.value.split("  ")) == 50


def test_text_and_nothing_have_no_unit():
    assert [row.unit for row in rows({"uniform_mm": None, "radius_mm_note": "any", "side_mm": 2.0})] == ["", "", "mm"]
