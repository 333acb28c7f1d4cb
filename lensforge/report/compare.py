"""Designs side by side on one page: their facts, where their specs differ, their light and sections on one scale."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.light.receiver_light import ReceiverLight
from lensforge.report.exported_part import source_outline
from lensforge.report.headline import further_facts, headline, required_facts, task
from lensforge.report.lens_figures import lens_section, reach_mm
from lensforge.report.light_figures import along, encircled_share, irradiance_map, label_positions, label_radii
from lensforge.report.page import PagePicture, picture, template
from lensforge.report.record_tables import rows
from lensforge.report.results import Results
from lensforge.results import Fact, Group
from lensforge.results.case import Case
from lensforge.results.chart import Chart, LightUnit, light_unit
from lensforge.results.figure_style import COLOURS, NARROW, WIDE, in_report_style, new_figure
from lensforge.results.numerals import NOTHING
from lensforge.results.verdict import TITLES, state_label
from lensforge.version import __version__

_MOST = 8  # columns: more do not fit on a page
# The better value of the facts for which there is one whatever the spec.
_BETTER = {"nmse": min, "efficiency": max, "share_in_target": max, "uniformity": max, "rsd": min}
_DASHES = ("solid", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)))  # curves that coincide remain visible
_APART = 5.0  # ratio of peaks or of receivers above which there is no common scale
_DARK = "#000004"  # the darkest of the map's colours, outside the receiver


def render_comparison(designs: Sequence[Results], names: Sequence[str] | None = None) -> str:
    """A page on the designs by ``names``, else their specs'. Raises :class:`InputError` unless they are 2 to 8."""
    if not 2 <= len(designs) <= _MOST:
        raise InputError(f"report: {len(designs)} designs given; a comparison takes from 2 to {_MOST}")
    names = spec_names(designs) if names is None else list(names)
    return template("compare.html").render(
        names=names,
        tasks=[task(design.spec) for design in designs],
        headlines=[headline(design) for design in designs],
        numbers=number_lines(designs),
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
    """The folders' names, or paths where two are the same. Raises :class:`InputError` for a folder given twice."""
    if len({folder.resolve() for folder in folders}) < len(folders):
        raise InputError("report: the same folder is given twice; give each design once")
    short = [folder.resolve().name for folder in folders]
    return short if len(set(short)) == len(short) else list(map(str, folders))


def number_lines(designs: Sequence[Results]) -> list[Group]:
    """The main facts of all designs, by their labels; the note of the best is "best", where one is and they differ."""
    by_design = [{fact.label: fact for fact in (*required_facts(design), *further_facts(design))} for design in designs]
    first, *further = (design.spec.in_first_state.all_receivers for design in designs)
    same_target = all(target == first for target in further)
    lines = []
    for label in dict.fromkeys(label for labelled in by_design for label in labelled):
        facts = [labelled.get(label, Fact("", label, None)) for labelled in by_design]
        best = _best(facts) if same_target else None  # designs with the same text are equally good
        lines.append(_line(label, (replace(fact, note="best" if fact.text == best else "") for fact in facts)))
    judged = [design.verdict.cutting for design in designs]
    cutting = _line(TITLES["cutting"], (Fact("cutting", TITLES["cutting"], state_label(state)) for state in judged))
    return lines if set(judged) == {"undecided"} else [*lines, cutting]


def _line(title: str, facts: Iterable[Fact]) -> Group:
    return Group("line", title, tuple(facts))


def _best(facts: Sequence[Fact]) -> str | None:
    known = [(fact.value, fact) for fact in facts if isinstance(fact.value, float)]
    if not known or known[0][1].key not in _BETTER or len({fact.text for fact in facts}) == 1:
        return None
    return _BETTER[known[0][1].key](known, key=itemgetter(0))[1].text


def difference_lines(designs: Sequence[Results]) -> list[Group]:
    """The entries of the specs that are not the same in all designs, with preset and seed."""
    tables = []
    for design in designs:
        content = {"accuracy": design.lens.accuracy, "seed": design.lens.seed, **design.spec.model_dump()}
        tables.append({row.path: f"{row.value} {row.unit}".strip() for row in rows(content)})
    lines = []
    for path in dict.fromkeys(path for table in tables for path in table):
        texts = [table.get(path, NOTHING) for table in tables]
        if len(set(texts)) > 1:
            lines.append(_line(path, (Fact(path, path, text) for text in texts)))
    return lines


@dataclass(frozen=True)
class _Lit:
    name: str
    light: ReceiverLight
    unit: LightUnit
    colour: str
    dashes: str | tuple[float, tuple[float, ...]]
    caption: str

    @property
    def chart(self) -> Chart:
        return self.light.chart

    @property
    def peak(self) -> float:
        """Peak in its unit."""
        return self.unit.per_watt * float(self.light.map.max())


class ComparedPictures:
    """The pictures of ``designs`` by ``names``; of light where simulated, on every receiver, by its name if several."""

    def __init__(self, names: Sequence[str], designs: Sequence[Results]) -> None:
        self._designs = list(zip(names, designs, strict=True))
        candidates = ((name, design.find(Light)) for name, design in self._designs)
        lights = [(name, light) for name, light in candidates if light is not None]
        lumens_known = all(light.lumens_per_watt is not None for _, light in lights)
        shown = [
            (case.title(name), case.record, light) for name, light in lights for case in Case(light).among("receivers")
        ]
        self._lit = [
            _Lit(
                name,
                receiver,
                light_unit(light.lumens_per_watt if lumens_known else None, far_field=receiver.chart.far_field),
                COLOURS[index % len(COLOURS)],
                _DASHES[index % len(_DASHES)],
                f"{receiver.place[:1].upper()}{receiver.place[1:]}.",
            )
            for index, (name, receiver, light) in enumerate(shown)
        ]

    @cached_property
    def one_scale(self) -> bool:
        """True where the maps of all designs are legible with the same colours and lengths."""
        if len({lit.light.kind for lit in self._lit}) > 1:
            return False
        sides = [max(lit.chart.width, lit.chart.height) for lit in self._lit]
        return _spread([lit.peak for lit in self._lit]) <= _APART and _spread(sides) <= _APART

    @property
    def scale_words(self) -> str:
        """Sentence on the scale of the maps."""
        lengths = "angles" if self._lit and self._lit[0].chart.far_field else "millimetres"
        if self.one_scale:
            return f"All maps have the same colours and the same {lengths}."
        return f"Each map has its own colours and {lengths}: the designs differ too much for one scale."

    @cached_property
    def maps(self) -> list[PagePicture]:
        """Maps of light, all with the same colours and lengths where that is legible."""
        return [picture(f"map{index}", self._map(lit), lit.name, lit.caption) for index, lit in enumerate(self._lit)]

    def _map(self, lit: _Lit) -> Figure:
        shown = self._lit if self.one_scale else [lit]
        frame = Chart(
            max(receiver.chart.width for receiver in shown),
            max(receiver.chart.height for receiver in shown),
            lit.chart.far_field,
        )
        top = max(receiver.peak for receiver in shown) or 1.0
        width = WIDE if len(self._lit) <= 2 else NARROW
        figure = irradiance_map(
            lit.light.map, lit.chart, top / lit.unit.per_watt, unit=lit.unit, width=width, frame=frame
        )
        figure.axes[0].set_facecolor(_DARK)
        return figure

    @cached_property
    def curves(self) -> list[PagePicture]:
        """Lines across the receivers and encircled energy: all designs whose places have one unit in one picture."""
        groups = [[lit for lit in self._lit if lit.chart.far_field == far_field] for far_field in (False, True)]
        pictures: list[PagePicture] = []
        for lit in groups:
            if lit:
                where = ("in the far field" if lit[0].chart.far_field else "at a distance") if all(groups) else ""
                pictures += _curves(lit, "-far" if pictures else "", f", {where}" if where else "")
        return pictures

    @cached_property
    def sections(self) -> list[PagePicture]:
        """Sections at 0 deg, all to one scale."""
        reach = max(reach_mm(design.lens) for _, design in self._designs)
        return [
            picture(f"body{index}", lens_section(design.lens, 0.0, source_outline(design), reach), name)
            for index, (name, design) in enumerate(self._designs)
        ]


def _curves(lit: Sequence[_Lit], end: str, where: str) -> list[PagePicture]:
    share = "Share of each receiver's flux."
    return [
        picture(f"across{end}", _lines(lit, (1.0, 0.0)), f"Along y = 0{where}"),
        picture(f"up{end}", _lines(lit, (0.0, 1.0)), f"Along x = 0{where}"),
        picture(f"circles{end}", _circles(lit), f"Encircled energy{where}", share),
    ]


@in_report_style
def _lines(lit: Sequence[_Lit], direction: tuple[float, float]) -> Figure:
    figure, axes = new_figure(NARROW, 2.6)
    across, up = direction
    reaches = []
    for design in lit:
        half = 0.5 * (across * design.chart.width + up * design.chart.height)
        end = half * np.array(direction)
        values = design.unit.per_watt * along(design.light.map, -end, end, design.chart)
        axes.plot(np.linspace(-half, half, len(values)), values, color=design.colour)
        reaches.append(half)
    label_positions(axes, lit[0].chart, max(reaches))
    axes.set(ylabel=lit[0].unit.label)
    axes.set_ylim(bottom=0.0)
    return _named(figure, axes, lit)


@in_report_style
def _circles(lit: Sequence[_Lit]) -> Figure:
    figure, axes = new_figure(NARROW, 2.6)
    reaches = []
    for design in lit:
        radius, share = encircled_share(design.light.raw_map, design.chart)
        axes.plot(radius, share, color=design.colour)
        reaches.append(float(radius[-1]))
    right = axes.get_xlim()[1]
    label_radii(axes, lit[0].chart, max(reaches))
    axes.set(ylabel="share of the receiver's flux", xlim=(0.0, right), ylim=(0.0, 1.02))
    return _named(figure, axes, lit)


def _named(figure: Figure, axes: Axes, lit: Sequence[_Lit]) -> Figure:
    axes.grid(True)
    for line, design in zip(axes.lines, lit, strict=True):
        line.set(label=design.name, linestyle=design.dashes)
    figure.legend(loc="outside upper left", ncols=min(2, len(lit)), handlelength=1.3)
    return figure


def _spread(values: Sequence[float]) -> float:
    return max(values) / min(values) if values and min(values) > 0.0 else float("inf") if values else 1.0
