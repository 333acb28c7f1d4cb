"""Figures of receivers that are no squares: rectangles, the far field in degrees, and regions of uniform light."""

import io
from functools import partial

import numpy as np
import pytest
from matplotlib.patches import Circle
from PIL import Image

from lensforge.report import light_figures
from lensforge.results.chart import Chart, light_unit
from lensforge.results.notebook_html import plot_file
from lensforge.results.plots import plot_map

WIDE = Chart(300.0, 150.0)
SKY = Chart(2.0, 2.0, far_field=True)  # to 60 degrees: 4 sin 30


def ticks(axis):
    return dict(zip((label.get_text() for label in axis.get_ticklabels()), axis.get_ticklocs(), strict=True))


def slope(chart, rows, columns):
    """Light that rises with x and, twice as steeply, with y."""
    return 1000.0 + chart.x(columns)[None, :] + 2.0 * chart.y(rows)[:, None]


def test_the_far_field_is_labelled_in_degrees_where_they_lie():
    axes, bar = light_figures.irradiance_map(np.ones((8, 8)), SKY, 1.0, unit=light_unit(None, far_field=True)).axes
    assert (axes.get_xlabel(), axes.get_ylabel(), bar.get_ylabel()) == ("x (°)", "y (°)", "intensity (W/sr)")
    for axis in (axes.xaxis, axes.yaxis):
        labels = ticks(axis)
        assert list(labels) == ["−60", "−45", "−30", "−15", "0", "15", "30", "45", "60"]
        assert labels["30"] == pytest.approx(2.0 * np.sin(np.radians(15.0)))
        assert labels["60"] == pytest.approx(1.0)
    circles = [patch.radius for patch in axes.patches if isinstance(patch, Circle)]
    assert circles == pytest.approx([2.0 * np.sin(np.radians(0.5 * angle)) for angle in (15, 30, 45, 60)])
    assert axes.get_xlim() == axes.get_ylim() == (-1.0, 1.0)


def test_lines_and_circles_in_the_far_field_are_in_degrees():
    image = slope(SKY, 20, 20)
    (name, line), *_ = light_figures.profile_lines(image, SKY)
    axes = light_figures.line_comparison(line, image, image, SKY).axes[0]
    assert name == "y = 0" and axes.get_xlabel() == "position on the line (°)"
    assert ticks(axes.xaxis)["−45"] == pytest.approx(-2.0 * np.sin(np.radians(22.5)))
    axes = light_figures.encircled_energy(image, image, SKY).axes[0]
    assert axes.get_xlabel() == "angle from the axis (°)"
    assert ticks(axes.xaxis)["30"] == pytest.approx(2.0 * np.sin(np.radians(15.0)))
    assert axes.get_xlim()[0] == 0.0


def test_the_third_line_goes_where_the_target_is_brightest_or_to_the_largest_angle():
    bar = np.zeros((20, 20))
    bar[16] = 1.0
    assert light_figures.profile_lines(bar, SKY)[2][0] == "y = 37.93° (brightest row)"  # 2 asin(0.65 / 2)
    name, (start, end) = light_figures.profile_lines(bar, Chart(200.0, 200.0))[2]
    assert start[1] == end[1] == pytest.approx(65.0) and "65 mm" in name
    name, (start, end) = light_figures.profile_lines(np.ones((20, 20)), SKY)[2]
    assert name.startswith("x = y")
    assert np.linalg.norm(start) == np.linalg.norm(end) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("half_angle", "last"), [(0.1, "0.1"), (7.0, "6"), (60.0, "60"), (80.0, "60"), (90.0, "90"), (180.0, "180")]
)
def test_labels_are_round_angles_on_the_chart(half_angle, last):
    side = 4.0 * np.sin(np.radians(0.5 * half_angle))
    labels = ticks(plot_map(np.ones((4, 4)), Chart(side, side, far_field=True)).xaxis)
    assert list(labels)[-1] == last
    assert len(labels) <= 13
    assert max(labels.values()) <= 0.5 * side * (1.0 + 1e-9)


def test_a_rectangle_keeps_its_shape():
    image = slope(WIDE, 20, 40)
    for figure in (
        light_figures.irradiance_map(image, WIDE, float(image.max()), outline=image),
        light_figures.difference_map(image, WIDE),
        light_figures.isolines(image, WIDE),
    ):
        axes, bar = figure.axes
        figure.draw_without_rendering()
        box = axes.get_window_extent()
        assert box.width == pytest.approx(2.0 * box.height, rel=1e-6)
        assert bar.get_window_extent().height >= (1.0 - 1e-6) * box.height
        assert (axes.get_xlim(), axes.get_ylim()) == ((-150.0, 150.0), (-75.0, 75.0))


@pytest.mark.parametrize(("rows", "columns"), [(20, 40), (15, 31)])
def test_lines_across_a_rectangle_follow_its_slopes(rows, columns):
    image = slope(WIDE, rows, columns)
    (_, across), (_, up), (name, diagonal) = light_figures.profile_lines(image[::-1], WIDE)
    oblique = np.array([-80.0, 30.0]), np.array([60.0, -50.0])
    inside = slice(3, -3)  # between the centres of the outermost pixels
    for start, end in (across, up, oblique):
        values = light_figures.along(image, start, end, WIDE)
        expected = 1000.0 + np.linspace(start, end, 2 * columns) @ (1.0, 2.0)
        assert values[inside] == pytest.approx(expected[inside], abs=1e-9)
    assert across[1].tolist() == [150.0, 0.0] and up[1].tolist() == [0.0, 75.0]
    assert name.startswith("y =") and diagonal[1][0] == 150.0


@pytest.mark.parametrize("chart", [WIDE, Chart(200.0, 200.0)])
def test_uniform_light_gathers_as_the_area_of_a_circle(chart):
    pixels = np.ones((2 * int(chart.height), 2 * int(chart.width)))
    radius, share = light_figures.encircled_share(pixels, chart)
    inside = (radius > 20.0) & (radius < 0.5 * chart.height)
    assert share[inside] == pytest.approx(np.pi * radius[inside] ** 2 / (chart.width * chart.height), rel=0.01)
    assert radius[-1] == pytest.approx(0.5 * np.hypot(chart.width, chart.height), rel=0.01)
    assert share[-1] == 1.0 and (np.diff(share) >= 0.0).all()
    assert not light_figures.encircled_share(0.0 * pixels, chart)[1].any(), "a dark receiver gathers nothing"


@pytest.mark.parametrize("rows", [512, 1024])
def test_large_images_are_drawn_as_area_means_of_their_shape(rows):
    image = np.random.default_rng(0).random((rows, 1024))
    drawn = light_figures.drawn(image)
    assert drawn == pytest.approx(image.reshape(rows // 4, 4, 256, 4).mean(axis=(1, 3)), abs=1e-6)
    assert light_figures.drawn(np.ones((2, 2000))).shape == (1, 256)
    assert light_figures.drawn(image[:200, :200]).shape == (200, 200)


def border(mask, chart):
    axes = light_figures.irradiance_map(np.ones((8, 8)), chart, 1.0, mask=mask).axes[0]
    (contour,) = [item for item in axes.collections if hasattr(item, "levels")]
    assert (axes.get_xlim(), axes.get_ylim()) == (chart.extent[:2], chart.extent[2:])
    return np.concatenate([path.vertices for path in contour.get_paths()])


def test_the_border_of_a_turned_mask_off_the_centre_lies_where_the_mask_is():
    x, y = np.meshgrid(WIDE.x(600), WIDE.y(300))
    mask = np.abs(x - 40.0) + np.abs(y + 10.0) <= 30.0
    line = border(mask, WIDE)
    assert np.abs(line[:, 0] - 40.0) + np.abs(line[:, 1] + 10.0) == pytest.approx(30.0, abs=1.0)


def test_a_mask_as_large_as_the_receiver_has_its_border_at_the_edge():
    line = border(np.ones((16, 16), dtype=bool), WIDE)
    assert np.abs(line).max(axis=0) == pytest.approx([150.0, 75.0])


def test_a_map_in_a_file_has_room_for_its_labels():
    content = plot_file(partial(plot_map, slope(WIDE, 8, 8) / 2500.0, Chart(1650.0, 1650.0)), "png")
    drawn = np.asarray(Image.open(io.BytesIO(content)).convert("L"))
    assert drawn.min() < 50 and all((edge == 255).all() for edge in (drawn[0], drawn[-1], drawn[:, 0], drawn[:, -1]))
