"""Table of manufacturing and alignment errors on the page of a lens."""

import pytest
from page_text import Page, undrawn_page_of
from result_folders import make_results

from lensforge.errors import InputError
from lensforge.light.evaluation_result import LightMetrics
from lensforge.made.tolerance_result import ErrorRow, Sensitivity
from lensforge.report.sensitivity_rows import ChangeRow, change_rows
from lensforge.results import Metric
from lensforge.runs.results import Results


def metrics(nmse, efficiency, *errors):
    named = [Metric(value=value, standard_error=error) for value, error in zip((nmse, efficiency), errors, strict=True)]
    return LightMetrics(nmse=named[0], uniformity=None, rsd=None, efficiency=named[1])


def study(change=1.3e-4):
    row = ErrorRow(
        name="decentre in x",
        amount=20.0,
        unit="um",
        metrics=metrics(0.02013, 0.8475, 4e-4, 1e-3),
        change=metrics(change, -0.0025, 3.1e-5, 1.2e-4),
    )
    nominal = metrics(0.02, 0.85, 4e-4, 1e-3)
    return Sensitivity(inputs={}, nominal=nominal, rows=(row,), preset="standard", rays=4096, seconds=1.0)


def test_changes_are_shown_with_their_errors():
    plain = make_results()
    results = Results(plain.lens, plain.found | {"sensitivity": study()}, {})
    assert change_rows(plain) == []
    assert change_rows(results) == [
        ChangeRow("decentre in x", "20 um", "0.00013 ± 3\u2009×\u200910⁻⁵", "–", "–", "\u22120.0025 ± 0.0001")
    ]
    page = Page(undrawn_page_of(results))
    assert "sensitivity" in page.ids and "decentre in x" in page.text


def test_a_metric_without_a_region_is_not_drawn_as_unchanged():
    with pytest.raises(InputError, match="metric = 'uniformity': the spec names no region of uniform light"):
        study().plot(metric="uniformity")
