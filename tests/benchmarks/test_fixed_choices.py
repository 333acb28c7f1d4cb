"""The study of what is fixed in the program: the degree of the splines."""

from dataclasses import replace

import pytest
from convergence.tables import table_study
from scenes import random_surface, small_spec
from spline_degrees import degree_study

from lensforge.scene.lens import Lens
from lensforge.sources.build_source import build_source


@pytest.fixture(scope="module")
def measured():
    inner, outer = (random_surface(k, 3.0 * k, 0.01, (9, 25)) for k in (1, 2))
    lens = Lens.double(inner, outer, small_spec(base={"kind": "none"}), 0, "draft")
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
