"""``yield.html``: how many parts pass, how far their light scatters and why, and what each tolerance may be."""

from collections.abc import Iterator

import numpy as np

from lensforge.light.evaluation_result import Light
from lensforge.made.tolerance_result import Yield
from lensforge.made.yield_facts import (
    bound_words,
    budget_sentence,
    drawn_rows,
    failing_first,
    is_share,
    judged_metrics,
    metric_words,
    pass_sentence,
    worst_words,
)
from lensforge.report.headline import task
from lensforge.report.light_figures import irradiance_map
from lensforge.report.light_section import top_of, unit_of_light
from lensforge.report.page import PagePicture, picture, template
from lensforge.report.results import Results
from lensforge.report.study_figures import beyond, cause_bars, distribution
from lensforge.results import Group
from lensforge.results.chart import Chart
from lensforge.results.numerals import number, with_unit
from lensforge.version import __version__

YIELD_PAGE = "yield.html"
_MOST_PLOTS = 9  # of distributions: a spec may have hundreds of limits, all of which are in the tables


def render_yield(result: Yield, results: Results, table: str) -> str:
    """One self-contained page on ``result``; ``results``: of its lens; ``table``: name of the file with all parts."""
    facts = results.facts(result)
    return template(YIELD_PAGE).render(
        name=results.spec.name,
        subtitle=task(results.spec),
        conditions="" if result.conditions is None else str(result.conditions),
        result=result,
        sentence=pass_sentence(result),
        budget_sentence=budget_sentence(result),
        cards=[fact for fact in facts[0].facts if fact.key not in ("parts", "rays", "wanted")],
        bounds=_called(facts, "bound"),
        own_limits=bool(results.spec.limits),
        spreads=_called(facts, "spread"),
        distributions=_distributions(result),
        causes=_cause_pictures(result),
        budget=_called(facts, "budget"),
        worst=_worst_pictures(result, results),
        drawn=drawn_rows(result),
        rays=number(result.rays),
        seconds=number(result.seconds, 3),
        table=table,
        version=__version__,
    )


def _called(groups: list[Group], key: str) -> list[Group]:
    return [group for group in groups if group.key == key]


def _shown_metrics(result: Yield) -> list[str]:
    """Metrics that are drawn: those with bounds, then the others."""
    return list(dict.fromkeys([*failing_first(result), *result.metrics]))[:_MOST_PLOTS]


def _distributions(result: Yield) -> list[PagePicture]:
    found = []
    for index, name in enumerate(_shown_metrics(result)):
        values, spread = result.without_noise(name), result.metrics[name]
        bounds = [bound for bound in result.bounds if bound.metric == name]
        label = with_unit(metric_words(name), f"({spread.unit})" if spread.unit else "")
        figure = distribution(values, spread.designed.value, bounds, label, share=is_share(name))
        far = [bound_words(bound) for bound in bounds if beyond(values, bound.bound)]
        caption = f"The bound, {far[0]}, is far from all parts, and not drawn." if far else ""
        if spread.undecided:
            caption = f"Undecided: a part's ray noise outweighs the spread of the parts. {caption}".rstrip()
        found.append(picture(f"distribution{index}", figure, metric_words(name), caption))
    return found


def _cause_pictures(result: Yield) -> list[PagePicture]:
    names = [name for name in _shown_metrics(result) if name in result.variance]
    shown = [name for name in names if name in judged_metrics(result)] or names
    return [
        picture(f"causes{index}", cause_bars(result.variance[name]), metric_words(name))
        for index, name in enumerate(shown)
    ]


def _worst_pictures(result: Yield, results: Results) -> list[PagePicture]:
    """Light of the lens as designed, where it was evaluated, and of the worst parts, with the same colours."""
    section, unit = results.spec.all_receivers[0], unit_of_light(results)
    chart = Chart(*section.size, section.kind == "far_field")
    light = results.find(Light)
    maps = list(_worst_maps(result))
    designed = [] if light is None else [("As designed", "", light.receivers[0].map)]
    top = top_of(each for _, _, each in (designed or maps))
    return [
        picture(f"worst{index}", irradiance_map(image, chart, top, unit=unit), title, caption)
        for index, (title, caption, image) in enumerate((*designed, *maps))
    ]


def _worst_maps(result: Yield) -> Iterator[tuple[str, str, np.ndarray]]:
    """Title, caption and light of each of the worst parts."""
    for worst, image in zip(result.worst, result.worst_maps, strict=True):
        state = "passes" if worst.passes else "fails"
        yield f"Part {worst.part}: {state}", f"{worst_words(result, worst)}.", image
