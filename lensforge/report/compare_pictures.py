"""Pictures of several designs on one scale, so that colours, sizes and curves can be compared by eye."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lensforge.evaluation.light import Light
from lensforge.figures.light_unit import WATTS, LightUnit, light_unit
from lensforge.measurement.comparison import PhotoComparison
from lensforge.report.figure_style import BLUE, GREEN, GREY, INK, NARROW, ORANGE, RED, WIDE, in_report_style, new_figure
from lensforge.report.irradiance_figures import along, encircled_share, irradiance_map
from lensforge.report.measured import RELATIVE
from lensforge.report.numerals import number
from lensforge.report.pictures import PagePicture, picture, source_outline
from lensforge.report.section_figures import lens_section, reach_mm
from lensforge.results import Results

_COLOURS = (BLUE, ORANGE, GREEN, RED, "#8a5cc9", "#c2569b", GREY, INK)
_DASHES = ("solid", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)))  # curves that coincide remain visible
_APART = 5.0  # ratio of peaks or of receivers above which there is no common scale
_DARK = "#000004"  # the darkest of the map's colours, outside the receiver


class ComparedPictures:
    """The pictures of ``designs``, labelled ``names``; of light, only for those that have been simulated."""

    def __init__(self, names: Sequence[str], designs: Sequence[Results]) -> None:
        self._designs = list(zip(names, designs, strict=True))
        found = ((name, design, design.find(Light)) for name, design in self._designs)
        self._lit = [(name, design.spec, light) for name, design, light in found if light is not None]

    @cached_property
    def _units(self) -> list[LightUnit]:
        """Unit of each simulated design: lux only where the luminous efficacy of all is known."""
        units = [light_unit(light.lumens_per_watt) for _, _, light in self._lit]
        return units if WATTS not in units else [WATTS] * len(units)

    @cached_property
    def one_scale(self) -> bool:
        """True where the maps of all designs are legible with the same colours and millimetres."""
        sides = [light.receiver_mm for _, _, light in self._lit]
        return _spread(self._peaks) <= _APART and _spread(sides) <= _APART

    @cached_property
    def _peaks(self) -> list[float]:
        """Peak of each simulated design in its unit."""
        lit = zip(self._lit, self._units, strict=True)
        return [unit.per_w_m2 * float(light.map.max()) for (_, _, light), unit in lit]

    @cached_property
    def maps(self) -> list[PagePicture]:
        """Irradiance maps, all with the same colours and millimetres where that is legible."""
        lit = list(zip(self._lit, self._units, self._peaks, strict=True))
        widest = max((light.receiver_mm for _, _, light in self._lit), default=0.0)
        pictures, width = [], WIDE if len(self._designs) == 2 else NARROW
        for index, ((name, _, light), unit, peak) in enumerate(lit):
            top = (max(self._peaks) if self.one_scale else peak) or 1.0
            half = 0.5 * (widest if self.one_scale else light.receiver_mm)
            figure = irradiance_map(light.map, light.receiver_mm, top / unit.per_w_m2, unit=unit, width=width)
            figure.axes[0].axhspan(-half, half, color=_DARK, linewidth=0, zorder=-1.0)
            figure.axes[0].set(xlim=(-half, half), ylim=(-half, half))
            pictures.append(picture(f"map{index}", figure, name, f"At {light.distance_mm:g} mm."))
        return pictures

    @cached_property
    def curves(self) -> list[PagePicture]:
        """Lines across the receivers and encircled energy, all designs in one picture."""
        if not self._lit:
            return []
        return [
            picture("across", self._lines((1.0, 0.0)), "Along y = 0"),
            picture("up", self._lines((0.0, 1.0)), "Along x = 0"),
            picture("circles", self._circles(), "Encircled energy", "Share of each receiver's flux."),
        ]

    @cached_property
    def photographs(self) -> list[PagePicture]:
        """Photographs of the machined parts' light, each scaled to a mean of 1, on one scale."""
        found = ((name, design.find(PhotoComparison)) for name, design in self._designs)
        taken = [(name, photo) for name, photo in found if photo is not None]
        top = float(max((photo.measured.max() for _, photo in taken), default=1.0)) or 1.0
        pictures, width = [], WIDE if len(self._designs) == 2 else NARROW
        for index, (name, photo) in enumerate(taken):
            figure = irradiance_map(photo.measured, photo.receiver_mm, top, unit=RELATIVE, width=width)
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
    def _lines(self, direction: tuple[float, float]) -> Figure:
        figure, axes = new_figure(NARROW, 2.6)
        for (_, _, light), unit, colour in zip(self._lit, self._units, _COLOURS, strict=False):
            half = 0.5 * light.receiver_mm
            end = half * np.array(direction)
            values = unit.per_w_m2 * along(light.map, -end, end, light.receiver_mm)
            axes.plot(np.linspace(-half, half, len(values)), values, color=colour)
        axes.set(xlabel="position on the line (mm)", ylabel=self._units[0].label)
        axes.set_ylim(bottom=0.0)
        return self._named(figure, axes)

    @in_report_style
    def _circles(self) -> Figure:
        figure, axes = new_figure(NARROW, 2.6)
        for (_, _, light), colour in zip(self._lit, _COLOURS, strict=False):
            axes.plot(*encircled_share(light.raw_map, light.receiver_mm), color=colour)
        axes.set(xlabel="radius around the axis (mm)", ylabel="share of the receiver's flux", ylim=(0.0, 1.02))
        axes.set_xlim(left=0.0)
        return self._named(figure, axes)

    def _named(self, figure: Figure, axes: Axes) -> Figure:
        axes.grid(True)
        for index, (line, (name, _, _)) in enumerate(zip(axes.lines, self._lit, strict=True)):
            line.set(label=name, linestyle=_DASHES[index % len(_DASHES)])
        figure.legend(loc="outside upper left", ncols=min(2, len(self._lit)), handlelength=1.3)
        return figure


def _spread(values: Sequence[float]) -> float:
    """Ratio of the largest to the smallest; 1 for none."""
    return max(values) / min(values) if values and min(values) > 0.0 else float("inf") if values else 1.0
