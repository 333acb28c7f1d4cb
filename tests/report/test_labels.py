"""Labels of every figure of the page: none is cut off at the edge, and no two stand on each other."""

from dataclasses import replace
from itertools import combinations

import pytest
from matplotlib.text import Text
from nightly import first_by_day
from part_files import EXTRAS, verified
from result_folders import STAGES, make_results, small_lens
from shown_folders import SKY, WALL
from undrawn import without_views

from lensforge.report.lens_figures import lens_section
from lensforge.report.lens_page import render_report

TOUCH = 1.0  # pixel: boxes of texts have a margin


def boxes(figure):
    """Visible texts with their boxes in pixels, after the layout."""
    figure.draw_without_rendering()
    renderer = figure._get_renderer()
    texts = [each for each in figure.findobj(Text) if each.get_visible() and each.get_text().strip()]
    hidden = set(_undrawn(figure))
    return [(each.get_text(), each.get_window_extent(renderer)) for each in texts if each not in hidden]


def _undrawn(figure):
    """Labels of ticks beyond the limits, and of axes that are not drawn: they are there, but matplotlib hides them."""
    for axes in figure.axes:
        if axes.name == "3d":
            yield from axes.findobj(Text)
            continue
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            room = 1e-6 * (high - low)
            for tick in (*axis.majorTicks, *axis.minorTicks):
                if not (axes.axison and low - room <= tick.get_loc() <= high + room):
                    yield from (tick.label1, tick.label2)
            if not axes.axison:
                yield from (axis.label, axis.offsetText)


def faults(figure):
    """Texts that are cut off, and pairs of texts that collide."""
    found, width, height = boxes(figure), *(figure.get_size_inches() * figure.dpi)
    cut = [
        text for text, box in found if min(box.x0, box.y0) < -TOUCH or box.x1 > width + TOUCH or box.y1 > height + TOUCH
    ]
    return cut + [
        (one, other)
        for (one, first), (other, second) in combinations(found, 2)
        if min(first.x1, second.x1) - max(first.x0, second.x0) > TOUCH
        and min(first.y1, second.y1) - max(first.y0, second.y0) > TOUCH
    ]


# A floor 40 m wide: its places have five digits in mm. Pictures of the lens alone are those of the first lens.
FLOOR = {"kind": "rectangle", "width_mm": 3e4, "height_mm": 7e3, "distance_mm": 8e3, "receiver_mm": 4e4}
LENSES = {
    "two": ({"wanted": {"receivers": (WALL, SKY)}}, (*STAGES, *EXTRAS)),
    "one receiver": ({}, (*STAGES, *EXTRAS)),
    "a floor": ({"wanted": {"target": FLOOR}}, ("evaluate", "verify", "stray", "compare", "compare_outer")),
}


@pytest.mark.parametrize(("wanted", "stages"), first_by_day(1, LENSES.values(), "ten seconds each"), ids=LENSES)
def test_labels_are_whole_and_stand_alone(wanted, stages, monkeypatch):
    figures = {}

    def keep(figure, name, title):
        figures[name] = faults(figure)
        return ""

    monkeypatch.setattr("lensforge.report.page.to_svg", keep)
    with without_views():
        render_report(make_results(stages, small_lens(**wanted), verify=verified()))
    assert len(figures) > (30 if "design" in stages else 20)
    assert {name: found for name, found in figures.items() if found} == {}


@pytest.mark.parametrize("height_mm", first_by_day(2, [2.0, 2.5, 3.0, 5.0], "more heights"))
def test_the_label_below_a_base_of_any_height_is_whole(height_mm):
    lens = small_lens()
    lens = replace(lens, spec=lens.spec.replace(base={"height_mm": height_mm}))
    assert faults(lens_section(lens, 0.0, None)) == []
