import json

import numpy as np
import pytest
from part_files import whole_results

from lensforge.report.record_tables import rows
from lensforge.results import Metric
from lensforge.spec import ArrayTarget


def leaves(content):
    """Number of values; a metric counts as one, and so does an empty list."""
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


def test_files_under_other_conditions_have_names_of_their_own():
    nominal, other = (RESULTS["photometry"].contents(stem) for stem in ("photometry", "photometry_64rays"))
    assert not set(nominal) & set(other) and "lens.ies" in nominal and "lens_64rays.ies" in other


def test_a_metric_is_one_row_in_its_own_unit():
    (row,) = rows({"exit_w": Metric(value=0.75, unit="lm", standard_error=0.0025).model_dump()})
    assert (row.path, row.value, row.unit) == ("exit_w", "0.7500 ± 0.0025", "lm")
    (row,) = rows({"hit_mm": Metric(value=0.5).model_dump()})
    assert (row.path, row.value, row.unit) == ("hit_mm", "0.5", "mm")


def test_arrays_of_a_spec_are_told_apart_and_not_written_out():
    target = {"distance_mm": 100.0, "receiver_mm": 100.0, "width_mm": 50.0}
    first, second = (rows(ArrayTarget(values=np.eye(40) + offset, **target).model_dump()) for offset in (0.0, 1.0))
    (one,), (other,) = ([row.value for row in table if row.path == "values"] for table in (first, second))
    assert one.startswith("40 × 40 numbers")
    assert len(one) < 60
    assert one != other


def test_many_numbers_become_a_block_with_one_unit():
    (row,) = rows({"weights_mm": np.linspace(0.0, 1.0, 50).tolist()})
    assert row.block
    assert row.unit == "mm"
    assert len(row.value.split("  ")) == 50
