"""Section on photometry: numbers of the record with their errors and units, and pictures that agree with them."""

import numpy as np
import pytest
from made_photometry import make_photometry
from page_text import text_of
from result_folders import make_results, small_lens, with_leds
from shown_folders import REGION, ROAD

from lensforge.light.light_facts import photometry_facts
from lensforge.light.photometry_result import Photometry, WrittenFarFields, WrittenFile
from lensforge.report.lens_page import _photometry_sentence
from lensforge.report.study_figures import (
    ground_diagram,
    isocandela_diagram,
    polar_diagram,
)
from lensforge.results.figure_style import GREY
from lensforge.results.numerals import number


def road_lens(**changes):
    far = {"kind": "beam", "fwhm_deg": (60.0, 25.0), "half_angle_deg": 80.0}
    return small_lens(wanted={"target": far, "photometry": {**ROAD, **changes}})


def facts_of(lens, **changes):
    results = make_results(("photometry",), lens, photometry=make_photometry(lens, **changes))
    return {fact.label: fact for group in results.facts(results.photometry) for fact in group.facts}


def test_relative_candela_are_said():
    assert "flux is not stated" in facts_of(small_lens(), per_1000_lm=True)["Luminous flux"].note


def test_files_of_lamps_are_told_by_the_names_that_they_have_of_the_second_led_too():
    lens, file = road_lens(lenses=3), WrittenFile(lumens=1000.0, relative_error=1e-9)
    luminaire = WrittenFarFields(ies=file, ldt=file, tm33=file)
    leds = {led: make_photometry(lens, luminaire=luminaire, led=led) for led in ("near", "far")}
    made, spec = Photometry.joined(leds), with_leds(lens, "near", "far").spec
    told = {group.title: group.fact("luminaire").text for group in photometry_facts(made, spec) if group.key == "lamp"}
    assert told == {
        "Lamp, all 3 lenses, near": "luminaire.ies, .ldt, .iesxml",
        "Lamp, all 3 lenses, far": "luminaire_far.ies, .ldt, .iesxml",
    }
    assert {"luminaire.ies", "luminaire_far.ies"} <= made.file_names("photometry")


def test_light_of_a_receiver_in_its_unit():
    lens = small_lens(lumens_per_watt=200.0)
    region = REGION.model_copy(update={"region": "bright"})
    results = make_results(("evaluate",), lens, evaluate={"in_region": region, "lumens_per_watt": 200.0})
    light = results.facts(results.light)[0]
    assert light.fact("level").sentence == "500.0 ± 2.0 lx; where the target is above half of its maximum"
    assert [light.fact(key).text for key in ("u0", "u1")] == ["0.810 ± 0.020", "0.700 ± 0.030"]


def test_the_page_has_the_section_and_says_where_it_is_missing():
    page = text_of(make_results())
    assert "Beam angle, C 0" in page
    assert "There is no photometry.json" in text_of(make_results(("evaluate",)))
    for relative, phrase in ((False, "are absolute"), (True, "per 1000 lm of the source, whose flux is not known")):
        made = {"photometry": make_photometry(small_lens(), per_1000_lm=relative)}
        assert f"Candela and lumens {phrase}." in _photometry_sentence(
            make_results(("photometry",), small_lens(), **made)
        )


def _curves(figure, label):
    return next(line for line in figure.axes[0].lines if line.get_label() == label)


def test_the_polar_diagram_has_the_stated_beam():
    """Of its curve, directions at half of its length lie the beam angle apart; the longest is the peak."""
    photometry = make_photometry(small_lens())
    line = _curves(polar_diagram(photometry), "C 0 – C 180")
    x, y = line.get_data()
    radius, angle = np.hypot(x, y), np.rad2deg(np.arctan2(x, -y))
    assert radius.max() == pytest.approx(photometry.beam_c0.peak_cd.value)
    lit = angle[radius >= 0.5 * radius.max() - 1e-9]
    assert lit.max() - lit.min() == pytest.approx(photometry.beam_c0.beam_angle_deg.value, abs=1e-6)


@pytest.mark.parametrize(
    ("peak", "rings"), [(168_120.0, (60e3, 120e3, 180e3)), (1.7, (0.6, 1.2, 1.8)), (38.0, (15.0, 30.0, 45.0))]
)
def test_the_rings_of_the_polar_diagram_are_round_and_hold_the_curve(peak, rings):
    photometry = make_photometry(small_lens())
    scaled = photometry.candela * peak / photometry.candela.max()
    axes = polar_diagram(photometry.model_copy(update={"candela": scaled})).axes[0]
    assert [text.get_text() for text in axes.texts if not text.get_text().endswith("°")] == [
        number(ring, 3) for ring in rings
    ]
    drawn = [line.get_xdata().max() for line in axes.lines if line.get_color() == GREY and len(line.get_xdata()) > 2]
    assert drawn == pytest.approx(rings)


def test_a_beam_angle_that_a_limit_states_is_told_once():
    far = {"kind": "far_field", "half_angle_deg": 40.0, "targets": [{"kind": "beam", "fwhm_deg": 30.0}]}
    limits = [{"kind": "beam_angle", "azimuth_deg": 270.0, "at_most_deg": 40.0}]
    tenth = {"kind": "beam_angle", "azimuth_deg": 0.0, "level": 0.1, "at_most_deg": 60.0}
    for axis, asked, shown in (
        ((0.0, 0.0, 1.0), [*limits, tenth], {"beam_C 0"}),
        ((0.0, 0.1, 1.0), limits, {"beam_C 0", "beam_C 90"}),  # that of another plane
        ((0.0, 0.0, 1.0), [tenth], {"beam_C 0", "beam_C 90"}),
    ):
        lens = small_lens(wanted={"receivers": [far | {"axis": axis}], "limits": asked})
        keys = {fact.key for group in photometry_facts(make_photometry(lens), lens.spec) for fact in group.facts}
        assert {key for key in keys if key.startswith("beam_")} == shown
        assert {"field_C 0", "field_C 90"} <= keys


def test_isocandela_lines_lie_at_their_angles():
    """Half of a Lambertian peak is a circle at 60 degrees."""
    axes = isocandela_diagram(make_photometry(small_lens())).axes[0]
    lines = axes.collections[0].get_paths()
    half = lines[2].vertices  # of ISO_SHARES: 0.1, 0.25, 0.5
    assert np.allclose(np.hypot(*half.T), 60.0, atol=0.2)


def test_isocandela_lines_are_shares_of_the_peak_that_is_stated():
    """Noise is taken off a stated peak: half of one a tenth below that of the table is at arccos 0.45."""
    made = make_photometry(small_lens())
    stated = made.peak_cd.changed(value=0.9 * float(made.candela.max()))
    axes = isocandela_diagram(made.model_copy(update={"peak_cd": stated})).axes[0]
    half = axes.collections[0].get_paths()[2].vertices
    assert np.allclose(np.hypot(*half.T), np.rad2deg(np.arccos(0.45)), atol=0.2)
    assert f"{number(0.5 * stated.value, 3)} cd (50\u2009%)" in [line.get_label() for line in axes.lines]


def test_isolux_lines_of_a_lamp_lie_where_its_illuminance_is():
    """E = I0 / h^2 cos^4 gamma: a fifth of the largest is a circle of radius sqrt(sqrt(5) - 1) heights."""
    lens = road_lens()
    axes = ground_diagram(make_photometry(lens), 90.0, 24, 8.0).axes[0]
    fifth = axes.collections[2].get_paths()[0].vertices
    assert np.allclose(np.hypot(*fifth.T), np.sqrt(np.sqrt(5.0) - 1.0), atol=0.02)
    labels = [line.get_label() for line in axes.lines]
    assert f"{0.2 * 24 * 1000.0 / np.pi / 64.0:.2g} lx" in labels


def test_isolux_lines_reach_towards_the_street():
    """The file counts C the other way than the lens its azimuth: a street at 90 degrees is at C 270."""
    photometry = make_photometry(road_lens())
    towards = 1.0 + 0.5 * np.cos(np.deg2rad(photometry.c_deg - 270.0))[:, None]
    axes = ground_diagram(photometry.model_copy(update={"candela": photometry.candela * towards}), 90.0, 24, 8.0).axes[
        0
    ]
    along, across = axes.collections[2].get_paths()[0].vertices.T
    assert abs(along.mean()) < 0.05 and across.mean() > 0.1
