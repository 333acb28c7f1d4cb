"""Numbers read back from pictures: values of pixels and lines in their unit, bars end to end, curves on their side."""

import numpy as np
import pytest
from made_photometry import make_photometry
from result_folders import small_lens

from lensforge.made.tolerance_result import MetricBound
from lensforge.report import light_figures
from lensforge.report.study_figures import distribution, ground_diagram, isocandela_diagram, polar_diagram
from lensforge.results.chart import Chart, light_unit
from lensforge.shop import surface_figures

CHART = Chart(320.0, 160.0)
LUX = light_unit(200.0)
LIGHT = np.arange(32.0).reshape(4, 8) ** 2  # brighter to the right and, much more, upwards
OTHER = LIGHT[::-1] + 5.0


def test_maps_have_the_light_of_each_pixel_in_its_unit_the_first_row_below() -> None:
    (shown,) = light_figures.irradiance_map(LIGHT, CHART, 500.0, unit=LUX).axes[0].images
    assert shown.get_array().tolist() == (200.0 * LIGHT).tolist() and shown.get_clim() == (0.0, 1e5)
    assert (shown.origin, shown.get_extent()) == ("lower", [-160.0, 160.0, -80.0, 80.0])
    (apart,) = light_figures.difference_map(OTHER - LIGHT, CHART, LUX).axes[0].images
    assert apart.get_array().tolist() == (200.0 * (OTHER - LIGHT)).tolist()
    largest = 200.0 * float(np.abs(OTHER - LIGHT).max())
    assert apart.get_clim() == (-largest, largest)


def test_lines_have_both_lights_over_millimetres() -> None:
    ends = np.array([-150.0, 20.0]), np.array([150.0, 20.0])  # through the centres of the third row
    wanted, reached = light_figures.line_comparison(ends, LIGHT, OTHER, CHART, LUX).axes[0].lines
    for line, light, name in ((wanted, LIGHT, "target"), (reached, OTHER, "simulated")):
        assert line.get_label() == name
        assert line.get_xdata()[[0, -1]].tolist() == [-150.0, 150.0]
        at_centres = np.interp(CHART.x(8)[1:-1], line.get_xdata(), line.get_ydata())
        assert at_centres == pytest.approx(200.0 * light[2, 1:-1], rel=0.05)


def test_losses_stand_end_to_end_from_the_emitted_flux_to_what_is_kept() -> None:
    bars = light_figures.waterfall([("a", 0.1), ("b", 0.25)], [("c", 0.4), ("d", 0.25)]).axes[0].patches
    assert [(bar.get_x(), bar.get_width()) for bar in bars] == [
        pytest.approx(extent) for extent in ((0.0, 1.0), (0.9, 0.1), (0.65, 0.25), (0.0, 0.4), (0.4, 0.25))
    ]


def lamp():
    """A lens with more light towards C 0 than C 180, and more towards C 90 than all others."""
    photometry = make_photometry(small_lens())
    c, gamma = np.radians(photometry.c_deg)[:, None], np.radians(photometry.gamma_deg)
    candela = 100.0 * np.cos(gamma) * (1.0 + np.sin(gamma) * (0.3 * np.cos(c) + 0.6 * np.sin(c)))
    return photometry.model_copy(update={"candela": candela})


def test_a_polar_diagram_has_each_half_plane_on_its_side() -> None:
    curves = {line.get_label(): line.get_xydata() for line in polar_diagram(lamp()).axes[0].lines}
    spans = []
    for name, towards in (("C 0", 0.3), ("C 90", 0.6)):
        ((x, y),) = (curve.T for label, curve in curves.items() if label.startswith(name))
        gamma, light = np.arctan2(x, -y), np.hypot(x, y)
        assert light == pytest.approx(100.0 * np.cos(gamma) * (1.0 + towards * np.sin(gamma)), abs=0.5)
        spans.append(np.ptp(gamma))
    assert min(spans) > 3.0, "both half-planes"


def test_isocandela_lines_have_each_half_plane_on_its_side_and_their_names_there() -> None:
    """C 0 on the right, C 90 above: all along each line the intensity of its place is that of its label."""
    made = lamp()
    axes = isocandela_diagram(made.model_copy(update={"peak_cd": made.peak_cd.changed(value=120.0)})).axes[0]
    for line, share in zip(axes.collections[0].get_paths(), light_figures.ISO_SHARES, strict=True):
        x, y = line.vertices.T
        c, gamma = np.arctan2(y, x), np.radians(np.hypot(x, y))
        light = 100.0 * np.cos(gamma) * (1.0 + np.sin(gamma) * (0.3 * np.cos(c) + 0.6 * np.sin(c)))
        assert light == pytest.approx(share * 120.0, abs=0.5)
        assert share > 0.8 or np.ptp(c) > 4.0
    places = {text.get_text(): np.sign(np.round(text.get_position(), 6)).tolist() for text in axes.texts}
    assert [places[f"C {c}"] for c in (0, 90, 180, 270)] == [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]


def test_lux_on_the_ground_are_those_of_all_lenses_at_the_height_of_the_pole() -> None:
    """Largest under the lamp, where the intensity is 100 cd: of 24 lenses 8 m up it is 24 x 100 / 64 lx."""
    by_height, relative = (ground_diagram(lamp(), 90.0, 24, height).axes[0] for height in (8.0, None))
    labels = [line.get_label() for line in by_height.lines if line.get_label().endswith("lx")]
    top = 24.0 * 100.0 / 64.0
    assert [float(text.split()[0]) for text in labels] == pytest.approx(
        [share * top for share in (0.01, 0.05, 0.2, 0.5)], rel=0.15
    )
    assert any("of the maximum" in line.get_label() for line in relative.lines)


PARTS = np.array([4.0, 1.0, 3.0, 2.0])


@pytest.mark.parametrize(("designed", "low", "high"), [(4.5, 0.5, 5.0), (5.5, 0.0, 7.0), (-40.0, -3.0, 4.3)])
def test_the_distribution_of_parts_shows_all_bounds_near_them_and_their_wrong_sides(designed, low, high) -> None:
    """The parts are 3 wide, and 4.5 beside them is as far as anything is shown."""
    bounds = [
        MetricBound(metric="x", sense=sense, bound=bound, unit="") for sense, bound in (("<=", high), (">=", low))
    ]
    axes = distribution(PARTS, designed, bounds, "x (mm)", share=False).axes[0]
    shares, *verticals = axes.lines
    assert shares.get_xydata().tolist() == [[1.0, 25.0], [2.0, 50.0], [3.0, 75.0], [4.0, 100.0]]
    assert shares.get_drawstyle() == "steps-post", "so many have at most the value"
    near = [designed] if designed > -4.0 else []
    drawn = [(line.get_xdata()[0], line.get_label()) for line in verticals]
    assert drawn == [*((value, "as designed") for value in near), (high, "bound"), (low, drawn[-1][1])]
    assert drawn[-1][1].startswith("_"), "one entry in the legend"
    ends = [*PARTS, low, high, *near]
    margin = 0.04 * np.ptp(ends)
    left, right = min(ends) - margin, max(ends) + margin
    assert axes.get_xlim() == pytest.approx((left, right))
    spans = [patch.get_extents().transformed(axes.transData.inverted()).intervalx for patch in axes.patches]
    np.testing.assert_allclose(spans, [(high, right), (left, low)], atol=1e-9)


def test_maps_of_a_face_have_x_to_the_right_and_lengths_as_they_can_be_read() -> None:
    """0.02 mm is 20 um; 0.2 mm stays mm. A value at x low and y high is on the upper left."""
    for height, unit, shown in ((0.02, "µm", 20.0), (0.2, "mm", 0.2)):
        values = np.zeros((9, 9))
        values[2, 6] = height
        for make in (surface_figures.sag_map, surface_figures.uncut_map):
            axes, bar = make(values).axes
            array = np.ma.filled(axes.images[0].get_array(), 0.0)
            assert array[6, 2] == pytest.approx(shown) and axes.images[0].origin == "lower"
            assert f"({unit})" in bar.get_ylabel()
    at = {text.get_text().strip(): text.get_position() for text in axes.texts}
    assert at["x"][0] > 1.0 == at["x"][1] + 1.0 and at["y"][1] > 1.0 == at["y"][0] + 1.0, "beyond the rim, on the axes"
    circles = {patch.radius: patch.center for patch in axes.patches}
    for angle in (30.0, 60.0, 90.0):
        radius = np.hypot(*at[f"{angle:.0f}°"])
        assert radius == pytest.approx(np.tan(np.radians(angle) / 2.0))
        assert [circles[length] for length in circles if length == pytest.approx(radius)] == [(0.0, 0.0)]
    curved = surface_figures.curvature_map(np.where(values > 0.0, -2.0, -0.1), 1.0)
    assert curved.axes[0].images[0].get_array()[6, 2] == -2.0
    form = surface_figures.form_map(-1.5 * np.sign(values)).axes[0].images[0]
    assert form.get_array()[6, 2] == -1.5 and form.get_clim() == (-1.5, 1.5)
