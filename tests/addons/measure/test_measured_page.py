"""What pages and plots show of the machined part: maps with x to the right, along the axis."""

import numpy as np
import pytest
from measured_records import make_correction, make_surface
from result_folders import small_lens

from lensforge.addons.measure.measured_section import correction_pictures
from lensforge.report import page
from lensforge.shop import surface_figures


def same_where_known(pixels, values):
    """Beyond the rim of a face its map is filled as far as its circle reaches."""
    known = np.isfinite(values)
    assert known.sum() > 300 and pixels[known] == pytest.approx(values[known])


def test_the_pictures_of_a_second_cut_are_its_three_maps_with_x_to_the_right(monkeypatch):
    figures = {}
    monkeypatch.setattr(page, "to_svg", lambda figure, name, title: figures.setdefault(name, figure) and "")
    made = make_correction(small_lens())
    maps = {"deviation": 1.0, "correction": -2.0, "expected": 0.25}
    made = made.model_copy(update={f"{name}_map_um": f * made.deviation_map_um for name, f in maps.items()})
    correction_pictures(made)
    for name, field in (("first", "deviation"), ("correction", "correction"), ("second", "expected")):
        (image,) = figures[f"{name}-cut-inner"].axes[0].images
        same_where_known(np.ma.filled(image.get_array(), np.nan), getattr(made, f"{field}_map_um"))


def test_a_form_deviation_has_x_of_the_chart_to_the_right():
    surface = make_surface(small_lens())
    (shown,) = surface.plot().images
    assert np.array_equal(np.ma.filled(shown.get_array(), np.nan), surface.deviation_um, equal_nan=True)
    assert np.nanmax(np.diff(surface.deviation_um, axis=0)) == 0.0 < np.nanmin(np.diff(surface.deviation_um, axis=1))


def test_a_form_map_is_seen_along_the_axis_with_x_to_the_right():
    figure = surface_figures.form_map(np.transpose(make_surface(small_lens()).deviation_um))
    image = figure.axes[0].images[0].get_array()  # drawn [y, x]
    middle = image.shape[0] // 2
    assert image[middle, -2] > 6.0 > -6.0 > image[middle, 1]
    assert abs(image[1, middle]) < 0.5
