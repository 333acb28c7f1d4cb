"""Pictures of a road agree with its figures: from above, and by night."""

import numpy as np
import pytest
from made_photometry import make_photometry
from result_folders import make_results, small_lens
from shown_folders import ROAD

from lensforge.addons.road.road_figures import road_by_night, road_from_above
from lensforge.report import study_figures
from lensforge.report.added_section import ShownApplication
from lensforge.report.light_section import photometry_pictures

ON_A_ROAD = {"width_m": 7.0, "pole_height_m": 8.0, "pole_spacing_m": 30.0, "lamp_lm": 5000.0, "maintenance_factor": 0.8}


def lens_on(**road):
    far = {"kind": "beam", "fwhm_deg": (60.0, 25.0), "half_angle_deg": 90.0}
    return small_lens(wanted={"target": far, "roads": [ON_A_ROAD | road]})


def shown(photometry, lens):
    return ShownApplication(photometry, lens.spec, 0, 0)


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
    photometry = make_photometry(lens)
    night, above = (draw(shown(photometry, lens)).axes[:2] for draw in (road_by_night, road_from_above))
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
        assert mean == pytest.approx(photometry.roads[0].drivers[lane - 1].mean_cd_per_m2.value, rel=0.01)
        assert plan.images[0].get_array().mean() == pytest.approx(mean, rel=0.01)
        assert axes.get_title("left") == f"from lane {lane}" + (", oncoming" if heading < 0 else "")
        (arrow,) = (line for line in plan.lines if line.get_marker() in "<>")
        assert [*arrow.get_xydata()[0], arrow.get_marker()] == [15.0 - 15.0 * heading, eye_y, "<>"[heading > 0]]


@pytest.mark.parametrize("lighting_class", ["M4", "P2"])
def test_a_road_from_above_is_what_its_figures_say(lighting_class):
    """A view for each driver, the left lane first, whose mean is the stated one; of a path one, in lux."""
    lens = lens_on(lighting_class=lighting_class)
    photometry = make_photometry(lens)
    (judged,) = photometry.roads
    drawn = photometry_pictures(make_results(("photometry",), lens, photometry=photometry))
    assert [picture.title for picture in drawn][2:] == ["Road", "Road by night"][: 2 if lighting_class == "M4" else 1]
    views = road_from_above(shown(photometry, lens)).axes[:-1]  # the last is the colour bar
    means = [view.images[0].get_array().mean() for view in views]
    if lighting_class == "P2":
        assert means == pytest.approx([judged.mean_lx.value], rel=1e-3)
        return
    assert means == pytest.approx([driver.mean_cd_per_m2.value for driver in judged.drivers[::-1]], rel=1e-3)
    assert means[0] > 1.005 * means[1]
    assert [view.get_title("left")[:16] for view in views] == ["seen from lane 2", "seen from lane 1"]


def test_a_road_by_rp_8_from_above_has_a_view_for_each_direction_of_travel():
    lens = lens_on(lighting_class="local low", lanes=3, oncoming_lanes=1)
    photometry = make_photometry(lens)
    drivers = photometry.roads[0].drivers
    far, near = road_from_above(shown(photometry, lens)).axes[:-1]
    for view, driver, ends, label in ((far, drivers[1], (14 / 3, 7.0), "3"), (near, drivers[0], (0.0, 14 / 3), "1")):
        assert view.images[0].get_array().mean() == pytest.approx(driver.mean_cd_per_m2.value, rel=1e-3)
        assert view.images[0].get_extent() == pytest.approx([0.0, 30.0, *ends])
        assert view.get_title("left").startswith(f"from lane {label} on: mean {driver.mean_cd_per_m2.value:.2f} cd/m²")
        assert view.get_title("left").endswith(f"Lv/Lavg {driver.veiling_ratio.value:.2f}")
    drawn = photometry_pictures(make_results(("photometry",), lens, photometry=photometry))[2]
    assert "83 m" in drawn.caption


def test_views_of_a_road_have_metres_on_their_axes_and_each_driver_looks_ahead(monkeypatch):
    """The second of two unlike roads, with a lane against the others: its own size, and the eyes of both ways."""
    near = {"lighting_class": "M3", "width_m": 7.0, "pole_height_m": 9.0, "pole_spacing_m": 30.0, "lamp_lm": 3e3}
    wide = near | {"lighting_class": "collector low", "width_m": 12.0, "lanes": 3, "oncoming_lanes": 1}
    wide |= {"pole_spacing_m": 44.0, "pole_height_m": 11.0}
    far = {"kind": "beam", "fwhm_deg": (60.0, 25.0), "half_angle_deg": 90.0}
    lens = small_lens(wanted={"target": far, "roads": [near, wide], "photometry": ROAD})
    figure = road_from_above(ShownApplication(make_photometry(lens), lens.spec, 1, 0))
    views = []
    for axes in (axis for axis in figure.axes if axis.images):
        (mark,) = (line for line in axes.lines if line.get_marker() in "<>")
        views.append((axes.images[0].get_extent(), mark.get_marker(), *mark.get_xydata().tolist()))
    assert views == [([0.0, 44.0, 8.0, 12.0], "<", [44.0, 10.0]), ([0.0, 44.0, 0.0, 8.0], ">", [0.0, 2.0])]
    asked, drawn = [], study_figures.ground_diagram
    monkeypatch.setattr(study_figures, "ground_diagram", lambda *given: asked.append(given[1:]) or drawn(*given))
    photometry_pictures(make_results(("photometry",), lens, photometry=make_photometry(lens)))
    assert asked == [(90.0, 24, 9.0)], "the street, the lenses, and the poles of the first road"
