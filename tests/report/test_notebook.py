from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from result_folders import CONTENT, evaluate_arrays, make_folder, small_lens

from lensforge import report
from lensforge.errors import InputError

mpl.use("Agg")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_folder(tmp_path_factory.mktemp("notebook") / "whole", stl=True)


def parsed(markup):
    return ElementTree.fromstring(markup.replace("xlink:href", "href"))


def test_a_lens_shows_its_section_to_scale():
    lens = small_lens(text="<", bump_mm=0.0)
    markup = lens._repr_html_()
    corners = parsed(markup).find(".//polygon").get("points").split()
    radii = np.hypot(*np.array([corner.split(",") for corner in corners], dtype=float).T)
    assert radii[:181] == pytest.approx(10.0, rel=1e-3)
    assert radii[181:] == pytest.approx(4.0, rel=1e-3)
    assert "n = 1.4936" in markup


def test_a_folder_shows_verdict_numbers_and_pictures(folder):
    shown = report.ResultFolder(folder)
    root = parsed(shown._repr_html_())
    text = "".join(root.itertext())
    assert "All 5 gates hold." in text
    assert "All 5 gates hold." in repr(shown)
    assert len([node for node in root.iter() if node.tag.endswith("svg")]) == 2
    for label in ("NMSE", "Lens radius", "Form error", "Ball mill", "Exported part"):
        assert label in text


def test_the_plotted_light_is_the_one_in_the_file(folder):
    axes = report.plot_irradiance(folder)
    assert np.asarray(axes.images[0].get_array()) == pytest.approx(evaluate_arrays()["irradiance"])
    assert axes.images[0].get_extent() == [-150.0, 150.0, -150.0, 150.0]


def test_plots_go_on_the_caller_s_axes(folder):
    import matplotlib.pyplot as plt

    _, grid = plt.subplots(2, 2)
    for axes, plot in zip(
        grid.flat,
        (report.plot_irradiance, report.plot_section, report.plot_encircled_energy, report.plot_history),
        strict=True,
    ):
        assert plot(folder, axes=axes) is axes
        assert axes.has_data()
    plt.close("all")


@pytest.mark.parametrize("quantity", ["nmse", "efficiency", "g3_mm"])
def test_the_plotted_history_is_the_one_in_the_file(folder, quantity):
    lines = report.plot_history(folder, quantity).lines
    assert [line.get_ydata().tolist() for line in lines] == [level[quantity] for level in CONTENT["design"]["history"]]
    assert [line.get_xdata().tolist() for line in lines] == [[1, 2, 3], [4, 5, 6, 7]]


def test_a_section_needs_no_folder():
    assert report.plot_section(small_lens(), 90.0).get_xlabel() == "y (mm)"


def test_plotters_hold_the_part_and_the_slope(folder):
    part = report.plot_part(folder, off_screen=True)
    assert part.bounds[1] - part.bounds[0] == pytest.approx(10.0, rel=0.02)
    half = report.plot_part(folder, cut=True, off_screen=True)
    assert half.bounds[2] == pytest.approx(0.0, abs=1e-6)
    lens = small_lens(bump_mm=1.0)
    surface = report.plot_outer_surface(lens, off_screen=True).mesh
    points, slope = np.asarray(surface.points, dtype=float), np.asarray(surface.active_scalars)
    radius, beside = np.linalg.norm(points, axis=1), np.hypot(points[:, 0], points[:, 1])
    off_axis = beside > 0.1
    u, radius, slope = (values[off_axis] for values in (points / radius[:, None], radius, slope))
    assert lens.outer.radius(u) == pytest.approx(radius, abs=1e-5)
    along = np.cross(np.cross([0.0, 0.0, 1.0], u), u)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    assert slope == pytest.approx(np.sum(lens.outer.gradient(u) * along, axis=1), abs=1e-4)
    assert np.abs(slope).max() > 0.1


def test_what_is_missing_is_one_line(tmp_path):
    make_folder(tmp_path, stages=())
    with pytest.raises(InputError, match="lensforge evaluate"):
        report.plot_irradiance(tmp_path)
    with pytest.raises(InputError, match="lensforge design"):
        report.plot_history(tmp_path)
    with pytest.raises(InputError, match="lensforge export"):
        report.plot_part(tmp_path)


def test_every_public_name_is_there():
    for name in report.__all__:
        assert callable(getattr(report, name))
    with pytest.raises(AttributeError):
        _ = report.nothing
