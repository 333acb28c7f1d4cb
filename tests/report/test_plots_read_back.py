"""Plots of results read back: what a record holds stands on its axes, with its errors and on its side."""

import numpy as np
import pytest
from drawn_page import TURNED
from made_photometry import make_photometry
from made_yield import make_yield
from part_files import make_stray, verified
from result_folders import make_proof, small_lens
from shown_folders import SKY, make_sensitivity

from lensforge.results import Metric


def curves_of(axes):
    return {line.get_label(): line.get_data() for line in axes.lines}


def test_the_effect_of_each_tolerance_has_its_standard_error():
    (first,) = make_sensitivity().rows
    smaller = first.change.model_copy(update={"efficiency": Metric(value=0.001, standard_error=2e-5)})
    second = first.model_copy(update={"name": "tilt", "change": smaller})
    study = make_sensitivity(rows=(first, second))
    axes = study.plot(metric="efficiency")
    changes = [row.change.efficiency for row in study.rows]
    assert [bar.get_width() for bar in axes.patches] == [change.value for change in changes]
    (errors,) = [collection for collection in axes.collections if hasattr(collection, "get_segments")]
    ends = [segment[:, 0].tolist() for segment in errors.get_segments()]
    assert ends == [[e.value - e.standard_error, e.value + e.standard_error] for e in changes]
    assert axes.yaxis_inverted() and axes.get_yticklabels()[0].get_text().startswith(study.rows[0].name)


def test_the_parts_of_a_study_have_their_design_and_their_bound():
    study = make_yield(small_lens())
    for metric, number in (("nmse", 0), ("share_in_target", 1)):
        curves = curves_of(study.plot(metric=metric))
        assert curves["parts"][0].tolist() == sorted(study.column(metric).tolist())
        assert curves["parts"][1] == pytest.approx([100.0 * k / study.parts for k in range(1, study.parts + 1)])
        assert curves["as designed"][0][0] == study.metrics[metric].designed.value
        assert curves["bound"][0][0] == study.bounds[number].bound


def test_displacements_of_each_tracer_are_its_own():
    proof = make_proof(small_lens(), **verified())
    for name, gaps in (("exported mesh", "gaps_mesh_mm"), ("STEP", "gaps_step_mm"), ("Mitsuba", "gaps_mitsuba_mm")):
        x, y = curves_of(proof.plot())[name]
        assert np.array_equal(x, getattr(proof.first, gaps)) and (y[0], y[-1]) == (0.0, 1.0)


def test_stray_light_is_plotted_on_the_receiver_that_is_named():
    first, second = make_stray(small_lens(wanted={"receivers": (TURNED, SKY)})).receivers
    second = second.model_copy(update={"stray": second.stray + np.arange(second.stray.size).reshape(16, 16)})
    stray = make_stray(small_lens(wanted={"receivers": (TURNED, SKY)})).model_copy(
        update={"receivers": (first, second)}
    )
    for chosen, receiver, which in ((None, first, "direct"), ("sky", second, "stray")):
        (shown,) = stray.plot(which=which, receiver=chosen).images
        assert np.array_equal(np.asarray(shown.get_array()), getattr(receiver, which)) and shown.origin == "lower"


def test_intensities_are_those_of_their_half_planes():
    photometry = make_photometry(small_lens())
    candela = photometry.candela * (1.0 + np.arange(len(photometry.c_deg)))[:, None]
    curves = curves_of(photometry.model_copy(update={"candela": candela}).plot())
    for c_deg in (0.0, 90.0):
        gamma, light = curves[f"C = {c_deg:g}°"]
        row = int(np.flatnonzero(photometry.c_deg == c_deg)[0])
        assert np.array_equal(gamma, photometry.gamma_deg) and light == pytest.approx(candela[row])
