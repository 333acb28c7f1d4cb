"""Designs side by side on one page: their numbers, where their specs differ, their light and sections on one scale."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.report.cards import cards
from lensforge.report.compare_pictures import ComparedPictures
from lensforge.report.headline import headline
from lensforge.report.numerals import number_with_error
from lensforge.report.page import template
from lensforge.report.tables import rows
from lensforge.report.task import task
from lensforge.results import Metric
from lensforge.runs.results import Results
from lensforge.version import __version__

_MOST = 8  # columns: more do not fit on a page
_ABSENT = "–"

# The better value of the metrics for which there is one whatever the spec.
_BETTER = {"NMSE": min, "Efficiency": max, "Uniformity": max, "RSD": min}


@dataclass(frozen=True)
class Cell:
    """One number of one design."""

    text: str
    state: str = ""
    best: bool = False


@dataclass(frozen=True)
class Line:
    """One row of a table: its name, and a cell for each design."""

    name: str
    cells: tuple[Cell, ...]


def render_comparison(designs: Sequence[Results], names: Sequence[str] | None = None) -> str:
    """One self-contained page on two to eight designs; ``names``: by default those of their specs.

    Raises :class:`InputError` for another number of designs.
    """
    if not 2 <= len(designs) <= _MOST:
        raise InputError(f"report: {len(designs)} designs given; a comparison takes from 2 to {_MOST}")
    names = spec_names(designs) if names is None else list(names)
    return template("compare.html").render(
        names=names,
        tasks=[task(design.spec) for design in designs],
        headlines=[headline(design) for design in designs],
        numbers=[*number_lines(designs), *receiver_lines(designs)],
        differences=difference_lines(designs),
        pictures=ComparedPictures(names, designs),
        version=__version__,
    )


def spec_names(designs: Sequence[Results]) -> list[str]:
    """The names of the designs' specs, numbered where two are the same."""
    names = [design.spec.name for design in designs]
    if len(set(names)) == len(names):
        return names
    return [f"{name} ({index})" for index, name in enumerate(names, start=1)]


def folder_names(folders: Sequence[Path]) -> list[str]:
    """The folders' names, or their whole paths where two names are the same.

    Raises :class:`InputError` where the same folder is given twice.
    """
    if len({folder.resolve() for folder in folders}) < len(folders):
        raise InputError("report: the same folder is given twice; give each design once")
    short = [folder.resolve().name for folder in folders]
    return short if len(set(short)) == len(short) else list(map(str, folders))


def number_lines(designs: Sequence[Results]) -> list[Line]:
    """The headline numbers; the best is marked where one value is better than another and they differ."""
    found = [{card.label: card for card in cards(design)} for design in designs]
    lines = []
    for label in dict.fromkeys(label for labelled in found for label in labelled):
        cells = [labelled.get(label) for labelled in found]
        texts = [f"{card.value} {card.unit}".strip() if card else _ABSENT for card in cells]
        best = _best(label, designs) if len(set(texts)) > 1 else None
        mark = None if best is None else texts[best]  # designs with the same text are equally good
        lines.append(
            Line(
                label,
                tuple(
                    Cell(text, card.state if card else "", text == mark)
                    for text, card in zip(texts, cells, strict=True)
                ),
            )
        )
    judged = [design.verdict.cutting for design in designs]
    return lines if set(judged) == {"undecided"} else [*lines, Line("Cutting", tuple(map(Cell, judged)))]


def _best(label: str, designs: Sequence[Results]) -> int | None:
    """Index of the design with the best value of the number called ``label``; None for different targets."""
    first, *others = (design.spec.all_receivers for design in designs)
    if label not in _BETTER or any(each != first for each in others):
        return None
    metrics: list[Metric | None] = [getattr(design.find(Light), label.lower(), None) for design in designs]
    values = [None if metric is None else metric.value for metric in metrics]
    known = [value for value in values if value is not None]
    return values.index(_BETTER[label](known)) if known else None


def receiver_lines(designs: Sequence[Results]) -> list[Line]:
    """The metrics on every receiver but the first, whose are among the headline numbers; by the receivers' names."""
    lights = [design.find(Light) for design in designs]
    tables = [{each.name: each for each in light.receivers[1:]} if light else {} for light in lights]
    lines = []
    for name in dict.fromkeys(name for table in tables for name in table):
        for label, digits in (("nmse", 3), ("efficiency", 4), ("uniformity", 3)):
            metrics: list[Metric | None] = [getattr(table.get(name), label, None) for table in tables]
            if any(metric is not None for metric in metrics):
                cells = tuple(Cell(number_with_error(metric, digits)) for metric in metrics)
                lines.append(Line(f"{'NMSE' if label == 'nmse' else label.capitalize()} on {name}", cells))
    return lines


def difference_lines(designs: Sequence[Results]) -> list[Line]:
    """The entries of the specs that are not the same in all designs, with preset and seed."""
    tables = []
    for design in designs:
        content = {"accuracy": design.lens.accuracy, "seed": design.lens.seed, **design.spec.model_dump()}
        tables.append({row.path: f"{row.value} {row.unit}".strip() for row in rows(content)})
    lines = []
    for path in dict.fromkeys(path for table in tables for path in table):
        texts = [table.get(path, _ABSENT) for table in tables]
        if len(set(texts)) > 1:
            lines.append(Line(path, tuple(Cell(text) for text in texts)))
    return lines
