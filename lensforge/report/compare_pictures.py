"""Pictures of several designs on one scale, so that colours, sizes and curves can be compared by eye."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lensforge.light.evaluation_result import Light
from lensforge.light.receiver_light import ReceiverLight
from lensforge.made.measurement_result import PhotoComparison
from lensforge.report.figure_style import BLUE, GREEN, GREY, INK, NARROW, ORANGE, RED, WIDE, in_report_style, new_figure
from lensforge.report.irradiance_figures import irradiance_map
from lensforge.report.line_figures import along, encircled_share, label_positions, label_radii
from lensforge.report.measured import RELATIVE
from lensforge.report.numerals import number
from lensforge.report.pictures import PagePicture, picture, source_outline
from lensforge.report.section_figures import lens_section, reach_mm
from lensforge.report.shown_receivers import capitalised, receivers_in
from lensforge.results.chart import Chart, LightUnit, light_unit
from lensforge.runs.results import Results

_COLOURS = (BLUE, ORANGE, GREEN, RED, "#8a5cc9", "#c2569b", GREY, INK)
_DASHES = ("solid", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)))  # curves that coincide remain visible
_APART = 5.0  # ratio of peaks or of receivers above which there is no common scale
_DARK = "#000004"  # the darkest of the map's colours, outside the receiver


@dataclass(frozen=True)
class _Lit:
    """The light of one design on one of its receivers."""

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
    """The pictures of ``designs``, labelled ``names``; of light, only for those that have been simulated.

    Light is that on every receiver; of several it is labelled with their names, too.
    """

    def __init__(self, names: Sequence[str], designs: Sequence[Results]) -> None:
        self._designs = list(zip(names, designs, strict=True))
        found = ((name, design, design.find(Light)) for name, design in self._designs)
        lights = [(name, design, light) for name, design, light in found if light is not None]
        lumens_known = all(light.lumens_per_watt is not None for _, _, light in lights)
        shown = [
            (f"{name}, {each.light.name}" if each.several else name, each.light, light)
            for name, design, light in lights
            for each in receivers_in(light, design.spec)
        ]
        self._lit = [
            _Lit(
                name,
                receiver,
                light_unit(light.lumens_per_watt if lumens_known else None, far_field=receiver.chart.far_field),
                _COLOURS[index % len(_COLOURS)],
                _DASHES[index % len(_DASHES)],
                f"{capitalised(receiver.place)}.",
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
            max(each.chart.width for each in shown), max(each.chart.height for each in shown), lit.chart.far_field
        )
        top = max(each.peak for each in shown) or 1.0
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
        found: list[PagePicture] = []
        for lit in groups:
            if lit:
                where = ("in the far field" if lit[0].chart.far_field else "at a distance") if all(groups) else ""
                found += self._curves(lit, "-far" if found else "", f", {where}" if where else "")
        return found

    def _curves(self, lit: Sequence[_Lit], end: str, where: str) -> list[PagePicture]:
        share = "Share of each receiver's flux."
        return [
            picture(f"across{end}", _lines(lit, (1.0, 0.0)), f"Along y = 0{where}"),
            picture(f"up{end}", _lines(lit, (0.0, 1.0)), f"Along x = 0{where}"),
            picture(f"circles{end}", _circles(lit), f"Encircled energy{where}", share),
        ]

    @cached_property
    def photographs(self) -> list[PagePicture]:
        """Photographs of the machined parts' light, each scaled to a mean of 1, on one scale."""
        found = ((name, design.find(PhotoComparison)) for name, design in self._designs)
        taken = [(name, photo) for name, photo in found if photo is not None]
        top = float(max((photo.measured.max() for _, photo in taken), default=1.0)) or 1.0
        pictures, width = [], WIDE if len(self._designs) == 2 else NARROW
        for index, (name, photo) in enumerate(taken):
            figure = irradiance_map(photo.measured, photo.chart, top, unit=RELATIVE, width=width)
            alike = f"SSIM to the simulation {number(photo.ssim, 3)}, NMSE {number(photo.nmse, 3)}."
            pictures.append(picture(f"photo{index}", figure, name, alike))
        return pictures

    @cached_property
    def sections(self) -> list[PagePicture]:
        """Sections at 0 deg, all to one scale."""
        reach = max(reach_mm(design.lens) for _, design in self._designs)
        return [
            picture(f"body{index}", lens_section(design.lens, 0.0, source_outline(design), reach), name)
            for index, (name, design) in enumerate(self._designs)
        ]


@in_report_style
def _lines(lit: Sequence[_Lit], direction: tuple[float, float]) -> Figure:
    figure, axes = new_figure(NARROW, 2.6)
    across, up = direction
    reaches = []
    for each in lit:
        half = 0.5 * (across * each.chart.width + up * each.chart.height)
        end = half * np.array(direction)
        values = each.unit.per_watt * along(each.light.map, -end, end, each.chart)
        axes.plot(np.linspace(-half, half, len(values)), values, color=each.colour)
        reaches.append(half)
    label_positions(axes, lit[0].chart, max(reaches))
    axes.set(ylabel=lit[0].unit.label)
    axes.set_ylim(bottom=0.0)
    return _named(figure, axes, lit)


@in_report_style
def _circles(lit: Sequence[_Lit]) -> Figure:
    figure, axes = new_figure(NARROW, 2.6)
    reaches = []
    for each in lit:
        radius, share = encircled_share(each.light.raw_map, each.chart)
        axes.plot(radius, share, color=each.colour)
        reaches.append(float(radius[-1]))
    right = axes.get_xlim()[1]
    label_radii(axes, lit[0].chart, max(reaches))
    axes.set(ylabel="share of the receiver's flux", xlim=(0.0, right), ylim=(0.0, 1.02))
    return _named(figure, axes, lit)


def _named(figure: Figure, axes: Axes, lit: Sequence[_Lit]) -> Figure:
    axes.grid(True)
    for line, each in zip(axes.lines, lit, strict=True):
        line.set(label=each.name, linestyle=each.dashes)
    figure.legend(loc="outside upper left", ncols=min(2, len(lit)), handlelength=1.3)
    return figure


def _spread(values: Sequence[float]) -> float:
    """Ratio of the largest to the smallest; 1 for none."""
    return max(values) / min(values) if values and min(values) > 0.0 else float("inf") if values else 1.0
