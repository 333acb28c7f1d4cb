"""The page with every section, drawn once for all tests that look at its pictures; and faults of a figure's labels."""

from itertools import combinations
from typing import NamedTuple

import pytest
from made_yield import make_yield
from matplotlib.text import Text
from part_files import whole_results
from result_folders import make_light, small_lens
from shown_folders import SKY, WALL
from undrawn import without_views

from lensforge.report import page
from lensforge.report.lens_page import render_report
from lensforge.report.light_section import ReceiverPictures, receiver_pictures
from lensforge.report.results import Results
from lensforge.results import Conditions

TURNED = {**WALL, "targets": tuple({**target, "rotation_deg": 45.0} for target in WALL["targets"])}


def whole_page_results():
    """Two receivers, all tracers, stray light, yield, measurements, another condition."""
    lens = small_lens(wanted={"receivers": (TURNED, SKY)})
    results = whole_results(lens=lens, **{"yield": make_yield(lens)}).found
    return Results(lens, results, {}, {"evaluate_64rays": make_light(lens, conditions=Conditions.of(rays=64))})


class DrawnPage(NamedTuple):
    """A page, the pictures of its receivers, and the faults of the labels of each figure by its name."""

    markup: str
    receivers: list[ReceiverPictures]
    faults: dict[str, list]


def draw_page(results):
    """The page on ``results`` without three-dimensional views."""
    by_name, draw = {}, page.to_svg

    def drawn(figure, name, title):
        by_name[name] = faults(figure)
        return draw(figure, name, title)

    with without_views(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "to_svg", drawn)
        return DrawnPage(render_report(results), receiver_pictures(results), by_name)


_TOUCH = 1.0  # pixel: boxes of texts have a margin


def _boxes(figure):
    """Visible texts with their boxes in pixels, after the layout."""
    figure.draw_without_rendering()
    renderer = figure._get_renderer()
    texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]
    hidden = set(_undrawn(figure))
    return [(text.get_text(), text.get_window_extent(renderer)) for text in texts if text not in hidden]


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
    boxes, width, height = _boxes(figure), *(figure.get_size_inches() * figure.dpi)
    cut = [
        text
        for text, box in boxes
        if min(box.x0, box.y0) < -_TOUCH or box.x1 > width + _TOUCH or box.y1 > height + _TOUCH
    ]
    return cut + [
        (one, other)
        for (one, first), (other, second) in combinations(boxes, 2)
        if min(first.x1, second.x1) - max(first.x0, second.x0) > _TOUCH
        and min(first.y1, second.y1) - max(first.y0, second.y0) > _TOUCH
    ]
