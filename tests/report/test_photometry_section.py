"""Section on photometry: numbers of the record with their errors and units, and pictures that agree with them."""

import numpy as np
import pytest
from made_photometry import make_photometry
from page_text import text_of
from result_folders import make_results, small_lens
from shown_folders import REGION, ROAD

from lensforge.light.light_facts import photometry_facts
from lensforge.light.photometry_result import Photometry, WrittenFarFields, WrittenFile
from lensforge.report import study_figures
from lensforge.report.lens_page import _photometry_sentence
from lensforge.report.light_section import photometry_pictures
from lensforge.report.study_figures import (
    ground_diagram,
    isocandela_diagram,
    polar_diagram,
    road_by_night,
    road_from_above,
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
    made = Photometry.joined(leds)
    told = {
        group.title: group.fact("luminaire").text for group in photometry_facts(made, lens.spec) if group.key == "lamp"
    }
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
    for relative, words in ((False, "are absolute"), (True, "per 1000 lm of the source, whose flux is not known")):
        made = {"photometry": make_photometry(small_lens(), per_1000_lm=relative)}
        assert f"Candela and lumens {words}." in _photometry_sentence(
            make_results(("photometry",), small_lens(), **made)
        )


def _curves(figure, label):
    return next(line for line in figure.axes[0].lines if line.get_label() == label)


def test_the_polar_diagram_has_the_stated_beam():
    """Of its curve, directions at half of its length lie the beam angle apart; the longest is the peak."""
    found = make_photometry(small_lens())
    line = _curves(polar_diagram(found), "C 0 – C 180")
    x, y = line.get_data()
    radius, angle = np.hypot(x, y), np.rad2deg(np.arctan2(x, -y))
    assert radius.max() == pytest.approx(found.beam_c0.peak_cd.value)
    lit = angle[radius >= 0.5 * radius.max() - 1e-9]
    assert lit.max() - lit.min() == pytest.approx(found.beam_c0.beam_angle_deg.value, abs=1e-6)


@pytest.mark.parametrize(
    ("peak", "rings"), [(168_120.0, (60e3, 120e3, 180e3)), (1.7, (0.6, 1.2, 1.8)), (38.0, (15.0, 30.0, 45.0))]
)
def test_the_rings_of_the_polar_diagram_are_round_and_hold_the_curve(peak, rings):
    found = make_photometry(small_lens())
    scaled = found.candela * peak / found.candela.max()
    axes = polar_diagram(found.model_copy(update={"candela": scaled})).axes[0]
    assert [text.get_text() for text in axes.texts if not text.get_text().endswith("°")] == [
        number(each, 3) for each in rings
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


def test_isolux_lines_of_a_lamp_lie_where_its_illuminance_is():
    """E = I0 / h^2 cos^4 gamma: a fifth of the largest is a circle of radius sqrt(sqrt(5) - 1) heights."""
    lens = road_lens()
    axes = ground_diagram(make_photometry(lens), 90.0, 24, 8.0).axes[0]
    fifth = axes.collections[2].get_paths()[0].vertices
    assert np.allclose(np.hypot(*fifth.T), np.sqrt(np.sqrt(5.0) - 1.0), atol=0.02)
    words = [line.get_label() for line in axes.lines]
    assert f"{0.2 * 24 * 1000.0 / np.pi / 64.0:.2g} lx" in words


def test_isolux_lines_reach_towards_the_street():
    """The file counts C the other way than the lens its azimuth: a street at 90 degrees is at C 270."""
    found = make_photometry(road_lens())
    towards = 1.0 + 0.5 * np.cos(np.deg2rad(found.c_deg - 270.0))[:, None]
    axes = ground_diagram(found.model_copy(update={"candela": found.candela * towards}), 90.0, 24, 8.0).axes[0]
    along, across = axes.collections[2].get_paths()[0].vertices.T
    assert abs(along.mean()) < 0.05 and across.mean() > 0.1


ON_A_ROAD = {"width_m": 7.0, "pole_height_m": 8.0, "pole_spacing_m": 30.0, "lamp_lm": 5000.0, "maintenance_factor": 0.8}


def lens_on(**road):
    far = {"kind": "beam", "fwhm_deg": (60.0, 25.0), "half_angle_deg": 90.0}
    return small_lens(wanted={"target": far, "roads": [ON_A_ROAD | road]})


@pytest.mark.parametrize(
    ("fields", "seats"),
    [
        ({}, [(2, 5.25, 1), (1, 1.75, 1)]),
        ({"driving_side": "left", "oncoming_lanes": 1}, [(1, 5.25, 1), (2, 1.75, -1)]),
    ],
)
def test_a_road_by_night_has_its_lamps_in_place_and_the_luminance_of_its_drivers(fields, seats):
    """From the left lane first. A lamp at the right edge is 6.5 m above the eye and y aside, at 60 m and at 90 m."""
    lens = lens_on(lighting_class="M4", **fields)
    found = make_photometry(lens)
    night, above = (draw(found, 0, lens.spec).axes[:2] for draw in (road_by_night, road_from_above))
    for (lane, eye_y, heading), axes, plan in zip(seats, night, above, strict=True):
        mesh, *_, heads = axes.collections
        middles = np.array([path.vertices[[0, 2]].mean(axis=0) for path in heads.get_paths()])
        for away in (60.0, 90.0):
            assert np.abs(middles - np.array([heading * eye_y, 6.5 - 0.06]) / away).max(axis=1).min() < 1e-9
        u, v = np.moveaxis(mesh.get_coordinates(), -1, 0)
        away = -1.5 / v
        assert np.allclose((u * away)[[0, -1]], heading * np.array([[eye_y], [eye_y - 7.0]]))  # the edges of the road
        rows, field = mesh.get_array().reshape(u.shape), np.arange(61.5, 90.0, 3.0)
        mean = np.mean([np.interp(field, ahead, row) for ahead, row in zip(away, rows, strict=True)])
        assert mean == pytest.approx(found.roads[0].drivers[lane - 1].mean_cd_per_m2.value, rel=0.01)
        assert plan.images[0].get_array().mean() == pytest.approx(mean, rel=0.01)
        assert axes.get_title("left") == f"from lane {lane}" + (", oncoming" if heading < 0 else "")
        (arrow,) = (line for line in plan.lines if line.get_marker() in "<>")
        assert [*arrow.get_xydata()[0], arrow.get_marker()] == [15.0 - 15.0 * heading, eye_y, "<>"[heading > 0]]


@pytest.mark.parametrize("lighting_class", ["M4", "P2"])
def test_a_road_from_above_is_what_its_figures_say(lighting_class):
    """A view for each driver, the left lane first, whose mean is the stated one; of a path one, in lux."""
    lens = lens_on(lighting_class=lighting_class)
    found = make_photometry(lens)
    (judged,) = found.roads
    drawn = photometry_pictures(make_results(("photometry",), lens, photometry=found))
    assert [each.title for each in drawn][2:] == ["Road", "Road by night"][: 2 if lighting_class == "M4" else 1]
    views = road_from_above(found, 0, lens.spec).axes[:-1]  # the last is the colour bar
    means = [view.images[0].get_array().mean() for view in views]
    if lighting_class == "P2":
        assert means == pytest.approx([judged.mean_lx.value], rel=1e-3)
        return
    assert means == pytest.approx([driver.mean_cd_per_m2.value for driver in judged.drivers[::-1]], rel=1e-3)
    assert means[0] > 1.005 * means[1]
    assert [view.get_title("left")[:16] for view in views] == ["seen from lane 2", "seen from lane 1"]


def test_a_road_by_rp_8_from_above_has_a_view_for_each_direction_of_travel():
    lens = lens_on(lighting_class="local low", lanes=3, oncoming_lanes=1)
    found = make_photometry(lens)
    drivers = found.roads[0].drivers
    far, near = road_from_above(found, 0, lens.spec).axes[:-1]
    for view, driver, ends, words in ((far, drivers[1], (14 / 3, 7.0), "3"), (near, drivers[0], (0.0, 14 / 3), "1")):
        assert view.images[0].get_array().mean() == pytest.approx(driver.mean_cd_per_m2.value, rel=1e-3)
        assert view.images[0].get_extent() == pytest.approx([0.0, 30.0, *ends])
        assert view.get_title("left").startswith(f"from lane {words} on: mean {driver.mean_cd_per_m2.value:.2f} cd/m²")
        assert view.get_title("left").endswith(f"Lv/Lavg {driver.veiling_ratio.value:.2f}")
    shown = photometry_pictures(make_results(("photometry",), lens, photometry=found))[2]
    assert "83 m" in shown.caption


def test_views_of_a_road_have_metres_on_their_axes_and_each_driver_looks_ahead(monkeypatch):
    """The second of two unlike roads, with a lane against the others: its own size, and the eyes of both ways."""
    near = {"lighting_class": "M3", "width_m": 7.0, "pole_height_m": 9.0, "pole_spacing_m": 30.0, "lamp_lm": 3e3}
    wide = near | {"lighting_class": "collector low", "width_m": 12.0, "lanes": 3, "oncoming_lanes": 1}
    wide |= {"pole_spacing_m": 44.0, "pole_height_m": 11.0}
    far = {"kind": "beam", "fwhm_deg": (60.0, 25.0), "half_angle_deg": 90.0}
    lens = small_lens(wanted={"target": far, "roads": [near, wide], "photometry": ROAD})
    figure = road_from_above(make_photometry(lens), 1, lens.spec)
    found = []
    for axes in (each for each in figure.axes if each.images):
        (mark,) = (line for line in axes.lines if line.get_marker() in "<>")
        found.append((axes.images[0].get_extent(), mark.get_marker(), *mark.get_xydata().tolist()))
    assert found == [([0.0, 44.0, 8.0, 12.0], "<", [44.0, 10.0]), ([0.0, 44.0, 0.0, 8.0], ">", [0.0, 2.0])]
    asked, drawn = [], study_figures.ground_diagram
    monkeypatch.setattr(study_figures, "ground_diagram", lambda *given: asked.append(given[1:]) or drawn(*given))
    photometry_pictures(make_results(("photometry",), lens, photometry=make_photometry(lens)))
    assert asked == [(90.0, 24, 9.0)], "the street, the lenses, and the poles of the first road"
