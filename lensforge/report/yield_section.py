"""Section of the report on the yield: how far the light of the parts scatters, why, and the worst of them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lensforge.light.evaluation_result import Light
from lensforge.made.board_light import periods_of
from lensforge.made.tolerance_result import Yield
from lensforge.made.yield_facts import (
    bound_words,
    budget_sentence,
    drawn_rows,
    failing_first,
    is_share,
    judged_metrics,
    metric_label,
    pass_sentence,
    worst_phrase,
)
from lensforge.report.light_figures import irradiance_map
from lensforge.report.light_section import top_of, unit_of_light
from lensforge.report.page import PagePicture, picture
from lensforge.report.results import Results, stem_of
from lensforge.report.study_figures import beyond, cause_bars, distribution
from lensforge.results import Group
from lensforge.results.chart import Chart
from lensforge.results.numerals import with_unit

_MOST_PLOTS = 9  # of distributions: a spec may have hundreds of limits, all of which are in the tables


@dataclass(frozen=True)
class YieldSection:
    """Facts, sentences and pictures of the ``result`` in the file ``stem``; ``drawn``: the tolerances."""

    stem: str
    result: Yield
    facts: list[Group]
    sentence: str
    budget: str
    distributions: list[PagePicture]
    causes: list[PagePicture]
    worst: list[PagePicture]
    drawn: list[Group]


def yield_sections(results: Results) -> list[YieldSection]:
    """Sections on the study of ``results``, and on those under other conditions: other tolerances, seeds, rays."""
    nominal = results.find(Yield)
    studies = results.others if nominal is None else {stem_of(nominal): nominal, **results.others}
    return [_section(stem, result, results) for stem, result in studies.items() if isinstance(result, Yield)]


def _section(stem: str, study: Yield, results: Results) -> YieldSection:
    names = list(dict.fromkeys([*failing_first(study), *study.metrics]))[:_MOST_PLOTS]  # those with bounds first
    varied = [name for name in names if name in study.variance and study.variance[name].certain]
    return YieldSection(
        stem=stem,
        result=study,
        facts=results.facts(study),
        sentence=pass_sentence(study),
        budget=budget_sentence(study),
        distributions=[_distribution(study, name, f"{stem}-{index}") for index, name in enumerate(names)],
        causes=[
            picture(f"{stem}-causes{index}", cause_bars(study.variance[name]), metric_label(name))
            for index, name in enumerate([name for name in varied if name in judged_metrics(study)] or varied)
        ],
        worst=_worst_pictures(stem, study, results),
        drawn=drawn_rows(study),
    )


def _distribution(study: Yield, name: str, on_page: str) -> PagePicture:
    """Histogram of the parts by one metric; bounds outside the plot range go to the caption."""
    values = study.without_noise(name)
    spread = study.metrics[name]
    bounds = [bound for bound in study.bounds if bound.metric == name]
    label = with_unit(metric_label(name), f"({spread.unit})" if spread.unit else "")
    figure = distribution(values, spread.designed.value, bounds, label, share=is_share(name))
    far = [bound_words(bound) for bound in bounds if beyond(values, bound.bound)]
    caption = f"The limit, {far[0]}, lies outside the plot." if far else ""
    if spread.undecided:
        caption = f"Undecided: the ray noise of a part exceeds the spread. {caption}".rstrip()
    return picture(on_page, figure, metric_label(name), caption)


def _worst_pictures(stem: str, study: Yield, results: Results) -> list[PagePicture]:
    """Light of the lens as designed, where it was evaluated, and of the worst parts, with the same colours.

    Of a lens for several LEDs that of each with which a part is worst.
    """
    (columns, rows) = periods_of(results.spec)
    light = results.find(Light)

    def chart_of(led: str) -> Chart:
        section = results.spec.of_state(led).all_receivers[0]
        width, height = section.size
        return Chart(columns * width, rows * height, section.is_far_field)

    cases = {} if light is None else {case.led: case for case in light.cases()}
    maps = list(_worst_maps(study))
    designed = [
        (led, cases[led].title("As designed"), "", np.tile(cases[led].result.first.map, (rows, columns)))
        for led in dict.fromkeys(study.worst_leds or ("",))
        if led in cases
    ]
    top = top_of(image for *_, image in (designed or maps))
    return [
        picture(
            f"{stem}-worst{index}",
            irradiance_map(image, chart_of(led), top, unit=unit_of_light(results, led=led)),
            title,
            caption,
        )
        for index, (led, title, caption, image) in enumerate((*designed, *maps))
    ]


def _worst_maps(study: Yield) -> Iterator[tuple[str, str, str, np.ndarray]]:
    leds = study.worst_leds or ("",) * len(study.worst)
    for worst, led, image in zip(study.worst, leds, study.worst_maps, strict=True):
        state = f"{f', {led}' if led else ''}: {'passes' if worst.passes else 'fails'}"
        yield led, f"Part {worst.part}{state}", f"{worst_phrase(study, worst)}.", image
