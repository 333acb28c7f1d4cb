"""The studies of what is fixed in the program: spline degree, precision, tolerance of the search."""

from dataclasses import replace

import pytest
from precision import precision_study, search_study
from scenes import random_surface, small_spec
from spline_degrees import degree_study

from lensforge.runs.tradeoff.tables import table_study
from lensforge.scene.lens import Lens
from lensforge.sources.build_source import build_source


@pytest.fixture(scope="module")
def measured():
    inner, outer = (random_surface(k, 3.0 * k, 0.01, (9, 25)) for k in (1, 2))
    lens = Lens(inner, outer, small_spec(base={"kind": "none"}), 0, "draft")
    return table_study(lens, build_source(lens.spec.source), (3.0, 5.0, 8.0, 12.0))


def levels(study, series):
    return [level for level in study.levels if level.series == series]


@pytest.mark.nightly("fifteen seconds, of a study that no command runs")
def test_a_spline_of_degree_k_converges_with_the_power_k_plus_one_and_its_slope_with_k(measured):
    study = degree_study(replace(measured, reference=measured.reference.thinned(8)), (5.0, 8.0, 12.0))
    for name, degree in (("linear", 1), ("quadratic", 2), ("cubic", 3), ("quintic", 5)):
        assert study.order[name]["rho"].value == pytest.approx(-degree - 1, abs=0.6)
        assert study.order[name]["normal"].value == pytest.approx(-degree, abs=0.6)
    cubic, fused = levels(study, "cubic"), {level.setting: level for level in levels(measured.study, "table")}
    for level in cubic:  # scipy's cubic and the tracer's are the same spline
        assert level.errors["rho"].value == pytest.approx(fused[level.setting].errors["rho"].value, rel=1e-3, abs=1e-4)
        assert level.errors["irradiance_nmse"].value > levels(study, "quintic")[-1].errors["irradiance_nmse"].value


@pytest.mark.nightly("of a study that no command runs")
def test_single_precision_costs_what_its_rounding_says(measured):
    study = precision_study(measured)
    single, double = levels(study, "tables")
    assert single.other["tables (MB)"] == double.other["tables (MB)"] / 2
    assert single.errors["hit_99_percent"].value > double.errors["hit_99_percent"].value
    rounded, exact = levels(study, "exact sum")
    assert exact.errors["hit"].value < 1e-11
    # some ten roundings of 2^-24 over the 100 mm to the receiver
    assert 1e-6 < rounded.errors["hit_99_percent"].value < 100 * 100 * 2.0**-24


@pytest.mark.nightly("of a study that no command runs")
def test_the_newton_step_squares_what_the_search_leaves(measured):
    study = search_study(measured, (0, 2, 4, 6, 8, 40))
    assert study.order["exact tracer"]["hit"].value == pytest.approx(2.0, abs=0.3)
    settings = [level.setting for level in study.levels]
    assert settings[0] / settings[1] == pytest.approx(4.0)
