import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from result_folders import face_maps, make_check, make_design, make_light, small_lens

from lensforge.light.receiver_light import Flux, MissedByCause
from lensforge.report import lens_figures, light_figures
from lensforge.results.chart import WATTS, Chart, LightUnit
from lensforge.results.figure_style import INK, to_svg
from lensforge.shop import shop_files, surface_figures
from lensforge.spec import BaseSection

SIDE = 200.0
CHART = Chart(SIDE, SIDE)
LUX = LightUnit("illuminance", "lx", 250.0)


def plane(pixels, x_slope, y_slope):
    axis = CHART.x(pixels)
    return 50.0 + x_slope * axis[None, :] + y_slope * axis[:, None]


@pytest.mark.parametrize("unit", [WATTS, LUX])
def test_maps_put_y_upwards_and_scales_in_mm_and_the_unit_of_light(unit):
    image = plane(16, 0.0, 0.2)
    axes, bar = light_figures.irradiance_map(image, CHART, 80.0, unit=unit).axes
    shown = axes.images[0]
    assert np.asarray(shown.get_array()) == pytest.approx(unit.per_watt * image)
    assert shown.get_extent() == [-100.0, 100.0, -100.0, 100.0]
    assert shown.origin == "lower"
    assert shown.get_clim() == (0.0, 80.0 * unit.per_watt)
    assert (axes.get_xlabel(), axes.get_ylabel(), bar.get_ylabel()) == ("x (mm)", "y (mm)", unit.label)


@pytest.mark.parametrize("difference", [plane(16, 0.1, 0.2) - 40.0, np.zeros((8, 8))])
def test_differences_are_centred_on_zero(difference):
    low, high = light_figures.difference_map(difference, CHART).axes[0].images[0].get_clim()
    assert -low == high == (np.abs(difference).max() or 1.0)


def test_the_flux_budget_closes():
    light = make_light(small_lens())
    flux, missed = light.flux, light.missed_by_cause
    lost = light_figures.losses(flux, missed)
    assert sum(share for _, share in lost) + flux.detected == pytest.approx(1.0)
    assert "emitted backwards" not in dict(lost), "a loss of zero is clutter"
    emitted, *steps, detected = light_figures.flux_budget(flux, missed).axes[0].patches
    edge = emitted.get_width()
    for step in steps:
        assert step.get_x() + step.get_width() == pytest.approx(edge)
        edge = step.get_x()
    assert detected.get_width() == pytest.approx(edge)


@pytest.mark.parametrize("unit", [WATTS, LUX])
def test_isolines_lie_where_the_light_has_the_share_that_they_name(unit):
    image = 80.0 * np.tile((np.arange(64) + 0.5) / 63.5, (64, 1))  # to 80 W/m^2 from left to right
    axes, scale = light_figures.isolines(image, CHART, unit).axes
    (contour,) = [item for item in axes.collections if hasattr(item, "levels")]
    for path, share in zip(contour.get_paths(), light_figures.ISO_SHARES, strict=True):
        assert path.vertices[:, 0] == pytest.approx(63.5 / 64.0 * share * SIDE - 0.5 * SIDE, abs=1e-6)
    named = [float(text.get_text().split("\n")[1].replace("\u2009", "")) for text in scale.texts[:-1]]
    assert named == pytest.approx([80.0 * share * unit.per_watt for share in light_figures.ISO_SHARES], rel=5e-3)


def test_isolines_of_many_pixels_are_shares_of_the_peak_of_the_means_that_are_drawn():
    """Columns that are bright and dark in turn, two for each that is drawn: their means rise to 80 W/m^2."""
    count = light_figures.MOST_DRAWN
    means = 80.0 * (np.arange(count) + 0.5) / (count - 0.5)
    image = np.tile(np.repeat(means, 2) * np.tile([0.0, 2.0], count), (2 * count, 1))
    axes, scale = light_figures.isolines(image, CHART).axes
    (contour,) = [item for item in axes.collections if hasattr(item, "levels")]
    assert contour.levels == pytest.approx([80.0 * share for share in light_figures.ISO_SHARES], rel=1e-6)
    named = [float(text.get_text().split("\n")[1].replace("\u2009", "")) for text in scale.texts[:-1]]
    assert named == pytest.approx([80.0 * share for share in light_figures.ISO_SHARES], rel=5e-3)


def test_a_loss_that_is_there_is_never_called_zero():
    nothing = MissedByCause(backward=0.0, outside_cavity=0.0, base=0.0, missed_receiver=0.0, surfaces_intersect=0.0)
    flux = Flux(detected=0.99999, outside=1e-5, missed=0.0, total_reflection=0.0, not_converged=0.0, reflected=0.0)
    axes = light_figures.flux_budget(flux, nothing).axes[0]
    assert "< 0.01 %" in [text.get_text() for text in axes.texts]


def test_every_loss_is_told_in_its_own_words():
    missed = MissedByCause(backward=0.01, outside_cavity=0.02, base=0.04, missed_receiver=0.08, surfaces_intersect=0.03)
    flux = Flux(
        detected=0.4, outside=0.05, missed=0.18, total_reflection=0.06, not_converged=0.07, reflected=0.12,
        absorbed=0.09, cover_glass=0.03,
    )  # fmt: skip
    lost = light_figures.losses(flux, missed, {"housing": 0.015, "louvre": 0.025})
    assert sum(share for _, share in lost) == pytest.approx(0.64)
    assert dict(lost) == {
        "emitted backwards": 0.01,
        "started outside the cavity": 0.02,
        "hit the base": 0.04,
        "missed the receiver": 0.08,
        "met intersecting surfaces": 0.03,
        "totally reflected": 0.06,
        "not converged": 0.07,
        "absorbed in the lens": 0.09,
        "reflected at the surfaces": 0.12,
        "lost in the cover glass": 0.03,
        "lost in the housing": 0.015,
        "lost in the louvre": 0.025,
        "outside the window": 0.05,
    }


@pytest.mark.parametrize("quantity", ["nmse", "efficiency", "loss"])
def test_history_runs_on_from_level_to_level(quantity):
    design = make_design(small_lens())
    axes = lens_figures.history(design.history, quantity).axes[0]
    for lines in (axes.lines, design.plot(quantity=quantity).lines):
        assert [list(line.get_xdata()) for line in lines] == [[1, 2, 3], [4, 5, 6, 7]]
        wanted = [list(getattr(level, quantity)) for level in design.history]
        assert [line.get_ydata().tolist() for line in lines] == wanted
    assert [text.get_text() for text in axes.texts] == ["9", "34"]


def test_constraints_run_on_from_level_to_level_and_what_is_not_allowed_is_shaded():
    levels = make_design(small_lens()).history
    axes = lens_figures.constraint_history(levels).axes[0]
    named = {"cavity_clearance_mm": "cavity", "wall_margin_mm": "thickness", "radius_margin_mm": "radius"}
    for name, label in named.items():
        first = next(line for line in axes.lines if line.get_label() == label)
        lines = [line for line in axes.lines if line.get_color() == first.get_color()]
        values = np.concatenate([line.get_ydata() for line in lines])
        assert values.tolist() == [value for level in levels for value in level.constraints[name]]
    shaded = axes.patches[-1].get_extents().transformed(axes.transData.inverted())
    assert shaded.y1 == pytest.approx(0.0, abs=1e-12)
    assert shaded.y0 < -0.375


def test_numbers_of_short_levels_do_not_cover_each_other():
    level = make_design(small_lens()).history[0]
    sizes = {9: 60, 34: 60, 115: 60, 404: 60, 1493: 1260}
    levels = [level.model_copy(update={"functions": n, "nmse": (0.1,) * steps}) for n, steps in sizes.items()]
    figure = lens_figures.history(levels, "nmse")
    figure.canvas.draw()
    boxes = [text.get_window_extent() for text in figure.axes[0].texts]
    assert len(boxes) == len(sizes)
    assert not any(box.overlaps(other) for k, box in enumerate(boxes) for other in boxes[:k])
    assert all(0.0 < box.y1 < figure.bbox.y1 for box in boxes)


def test_efficiencies_beside_each_other_have_labels_of_their_own():
    level = make_design(small_lens()).history[0].model_copy(update={"efficiency": (0.882, 0.876, 0.874)})
    figure = lens_figures.history([level], "efficiency")
    figure.canvas.draw()
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert len(labels) > 3 and len(set(labels)) == len(labels)


def test_a_map_is_empty_where_another_face_is():
    nodes = np.linspace(-1.0, 1.0, 41)
    radius = np.hypot(*np.meshgrid(nodes, nodes))
    cap = np.where(radius < 0.3, radius, np.nan)
    drawn = np.ma.filled(surface_figures.sag_map(cap).axes[0].images[0].get_array(), np.nan).T
    assert np.isnan(drawn[radius > 0.45]).all()
    assert np.isfinite(drawn[radius < 0.3]).all()


def test_the_curvature_map_marks_the_mill_only_where_it_is_too_large():
    kappa = face_maps()["kappa_min"]
    crossed = surface_figures.curvature_map(kappa, 1.0).axes[0]
    (contour,) = [item for item in crossed.collections if hasattr(item, "levels")]
    path = np.concatenate([line.vertices for line in contour.get_paths()])
    assert path[:, 1] == pytest.approx(-0.4, abs=0.02), "where -0.8 + 0.5 Y = -1, along Y and not X"
    fitting = surface_figures.curvature_map(kappa, 0.5).axes[0]
    assert not [item for item in fitting.collections if hasattr(item, "levels")]


@pytest.mark.parametrize("radius_mm", [1.0, None])
def test_pictures_of_a_handover_are_of_their_faces_with_the_line_of_the_tool(radius_mm):
    check = make_check(small_lens())
    inner = check.faces["inner"]
    cutter = None if radius_mm is None else inner.cutter.model_copy(update={"radius_mm": radius_mm})
    twice = {name: 2.0 * values for name, values in face_maps().items()}
    faces = {"inner": inner.model_copy(update={"cutter": cutter}), "outer": inner.model_copy(update=twice)}
    pictures = shop_files._pictures(check.model_copy(update={"inner": faces["inner"], "outer": faces["outer"]}))
    assert [title.partition(":")[0] for title, _ in pictures] == ["outer", "outer", "inner", "inner"]
    for (title, sag), (_, curved), face in zip(pictures[::2], pictures[1::2], list(faces.values())[::-1], strict=True):
        assert title.endswith("departure from the best-fit sphere")
        for figure, values in ((sag, face.sag_mm), (curved, face.kappa_min)):
            shown = np.ma.filled(figure.axes[0].images[0].get_array(), np.nan)
            known = np.isfinite(shown) & np.isfinite(values.T)
            assert known.sum() > 50 and shown[known] == pytest.approx(values.T[known])
        levels = [list(item.levels) for item in curved.axes[0].collections if hasattr(item, "levels")]
        assert levels == ([] if face.cutter is None else [[-1.0 / face.cutter.radius_mm]])
    told = f"; line: where a ball of {radius_mm:g} mm just fits" if radius_mm else ""
    assert pictures[3][0] == f"inner: smaller principal curvature{told}"


def test_maps_have_x_to_the_right_and_lose_no_sample():
    sag = face_maps()["sag_mm"]
    axes, bar = surface_figures.sag_map(sag).axes
    drawn = np.asarray(axes.images[0].get_array())
    known = ~np.isnan(sag.T)
    assert drawn[known] == pytest.approx(sag.T[known])
    nodes = np.linspace(-1.0, 1.0, len(sag))
    assert np.isfinite(drawn[np.hypot(*np.meshgrid(nodes, nodes)) < 1.0 + nodes[1] - nodes[0]]).all()
    assert bar.get_ylabel() == "deviation from the sphere (mm)"
    assert surface_figures.sag_map(1e-3 * sag).axes[1].get_ylabel() == "deviation from the sphere (µm)"


def labelled(axes):
    return {item.get_label(): item for item in [*axes.lines, *axes.patches]}


@pytest.mark.parametrize("azimuth", [0.0, 90.0])
def test_the_section_is_to_scale(azimuth):
    lens = small_lens()
    outline = 0.5 * np.array([[-2.0, -3.0, 0.0], [2.0, -3.0, 0.0], [2.0, 3.0, 0.0], [-2.0, 3.0, 0.0]])
    axes = lens_figures.lens_section(lens, azimuth, outline).axes[0]
    drawn = labelled(axes)
    width = {0.0: 2.0, 90.0: 3.0}[azimuth]
    assert drawn["source"].get_xdata().tolist() == [-0.5 * width, 0.5 * width]
    paraboloid = drawn["room for the LED"].get_xydata()
    assert paraboloid[0] == pytest.approx([-1.5, 0.0])
    assert paraboloid.max(axis=0) == pytest.approx([1.5, 1.0])
    assert np.hypot(*drawn["max. distance"].get_xydata().T) == pytest.approx(11.0)
    assert axes.get_aspect() == 1.0


def test_the_section_shows_the_base_as_it_is():
    lens = small_lens()
    base = BaseSection(diameter_mm=30.0, flat_mm=13.0, relief_step_mm=0.5, flange_diameter_mm=34.0)
    lens = replace(lens, spec=lens.spec.model_copy(update={"base": base}))
    axes = lens_figures.lens_section(lens, 0.0, None).axes[0]
    corners = {tuple(point) for point in np.round(labelled(axes)["lens"].get_xy(), 9)}
    assert {(13.0, -0.5), (-15.0, -0.5), (17.0, -1.5), (-17.0, -2.0)} <= corners
    assert axes.get_ylim()[0] < -2.0


def test_svg_is_well_formed_and_takes_the_colour_of_the_page():
    figure = light_figures.irradiance_map(plane(16, 0.1, 0.0), CHART, 80.0)
    svg = to_svg(figure, "name", 'less < "more" & more')
    root = ElementTree.fromstring(svg)
    assert root.get("aria-label") == 'less < "more" & more'
    assert INK not in svg
    assert "currentColor" in svg
    assert "font-family" not in svg
    assert "metadata" not in svg
    assert not re.search(r'(?:href="|url\()(?!#name-|data:)', svg)
    assert all(identifier.startswith("name-") for identifier in re.findall(r'\bid="([^"]+)', svg))


def test_the_same_results_make_the_same_picture_in_a_layout_of_its_own():
    levels = make_design(small_lens()).history
    figures = [lens_figures.history(levels, "nmse") for _ in range(2)]
    default = figures[0].axes[0].get_position().bounds
    first, second = (to_svg(figure, "name", "") for figure in figures)
    assert first == second
    assert figures[0].axes[0].get_position().bounds == figures[1].axes[0].get_position().bounds != default


def test_a_figure_is_laid_out_and_drawn_once(monkeypatch):
    figure = lens_figures.history(make_design(small_lens()).history, "nmse")
    drawn, whole = [], type(figure).draw
    monkeypatch.setattr(type(figure), "draw", lambda self, renderer: drawn.append(self) or whole(self, renderer))
    to_svg(figure, "name", "")
    assert drawn == [figure]
