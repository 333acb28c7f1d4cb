import re
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from made_photometry import make_photometry
from made_yield import make_yield
from result_folders import evaluate_arrays, make_folder, make_results, small_lens
from scenes import random_surface, sphere

import lensforge
from lensforge.errors import MissingResult
from lensforge.report.lens_page import results_html
from lensforge.report.results import STAGES
from lensforge.search.design_result import Design

mpl.use("Agg")


@pytest.fixture(scope="module")
def results():
    return make_results()


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


def test_a_lens_says_of_how_many_functions_in_how_many_levels_its_faces_are():
    faces = random_surface(1, 3.0, levels=(9, 25, 81), symmetry="mirror_x"), sphere(6.0)
    told = repr(lensforge.Lens.double(*faces, small_lens().spec, 0, small_lens().accuracy))
    assert "inner: 115 functions in 3 levels, symmetry mirror_x, outer: 4 functions in 1 levels, symmetry none" in told


def test_results_show_verdicts_numbers_and_pictures(results):
    root = parsed(results_html(results))
    text = "".join(root.itertext())
    assert "small: Photometry, CAD files and manufacture pass." in text
    assert len([node for node in root.iter() if node.tag.endswith("svg")]) == 2
    for label in ("Pattern error (NMSE)", "Outer radius", "Form error", "Largest ball", "NMSE against"):
        assert label in text


def test_the_plotted_light_is_the_one_of_the_record(results):
    axes = results.light.plot()
    assert np.asarray(axes.images[0].get_array()) == pytest.approx(evaluate_arrays()["map"])
    assert axes.images[0].get_extent() == [-150.0, 150.0, -150.0, 150.0]


def test_the_line_on_the_light_is_the_target_at_half_of_its_peak(results):
    target = np.zeros((16, 16))
    target[4:8, 6:14] = 3.0  # off the axes, longer than it is high
    first = results.light.receivers[0].model_copy(update={"target_map": target})
    axes = results.light.model_copy(update={"receivers": (first,)}).plot()
    lines = np.concatenate([path.vertices for path in axes.collections[0].get_paths()])
    pitch = 300.0 / 16.0
    assert lines.min(axis=0) == pytest.approx([-150.0 + 6.0 * pitch, -150.0 + 4.0 * pitch])
    assert lines.max(axis=0) == pytest.approx([-150.0 + 14.0 * pitch, -150.0 + 8.0 * pitch])
    assert not results.light.plot(which="target_map").collections, "the target itself has no line"


def test_a_result_that_is_printed_fits_on_a_screen(results, tmp_path):
    lens = results.lens
    folder = tmp_path / "own"
    make_folder(folder)
    printed = [*results.found.values(), make_yield(lens), make_photometry(lens), lens, lensforge.load(folder)]
    assert {type(record) for record in results.found.values()} == set(STAGES)
    for result in printed:
        for text in (str(result), repr(result)):
            assert text.count("\n") < 40 and len(text) < 6000, type(result)
    rows = str(results.find(Design)).splitlines()
    assert rows[0] == "Design" and "  constraints.wall_margin_mm          0.25" in rows
    assert re.search(r"^  exit_w +0\.90000 ± 0\.00010 W$", str(make_photometry(lens)), re.MULTILINE), (
        "a metric is one line"
    )
    assert str(make_yield(lens)).splitlines()[-1].startswith("  and "), "the rest is counted"
    assert "map=<16 x 16 numbers>" in repr(results.light)


def test_plots_go_on_the_caller_s_axes(results):
    import matplotlib.pyplot as plt

    _, grid = plt.subplots(2, 3)
    shown = (results.light, results.part, results.proof, results.design, results.check)
    for axes, result in zip(grid.flat, shown, strict=False):
        assert result.plot(axes) is axes
        assert axes.has_data()
    plt.close("all")


def test_what_is_missing_is_one_line():
    alone = make_results(())
    for name, command in (("light", "evaluate"), ("design", "design"), ("part", "export")):
        with pytest.raises(MissingResult, match=f"lensforge {command}"):
            getattr(alone, name)
