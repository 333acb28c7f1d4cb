from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from result_folders import evaluate_arrays, make_results, small_lens

from lensforge.errors import MissingResult
from lensforge.report.lens_page import results_html

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


def test_results_show_verdicts_numbers_and_pictures(results):
    root = parsed(results_html(results))
    text = "".join(root.itertext())
    assert "small: Light, files and cutting pass." in text
    assert len([node for node in root.iter() if node.tag.endswith("svg")]) == 2
    for label in ("Pattern error (NMSE)", "Farthest from the LED", "Form error", "Ball mill", "NMSE against"):
        assert label in text


def test_the_plotted_light_is_the_one_of_the_record(results):
    axes = results.light.plot()
    assert np.asarray(axes.images[0].get_array()) == pytest.approx(evaluate_arrays()["map"])
    assert axes.images[0].get_extent() == [-150.0, 150.0, -150.0, 150.0]


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
