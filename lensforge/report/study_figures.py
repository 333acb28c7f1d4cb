"""Figures of photometry, of the yield, and of the tracers that verify a part."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, PercentFormatter

from lensforge.light.photometry_result import Photometry
from lensforge.made.tolerance_result import MetricBound, Variance
from lensforge.made.yield_facts import TOGETHER
from lensforge.report.light_figures import ISO_SHARES
from lensforge.results.figure_style import (
    BLUE,
    DASHED,
    GREEN,
    GREY,
    INK,
    NARROW,
    ORANGE,
    RED,
    WIDE,
    in_report_style,
    new_figure,
)
from lensforge.results.numerals import number, percent
from lensforge.sources.intensity import TabulatedIntensity, plane_profile

_GAP_COLOURS = (BLUE, GREEN, ORANGE)
_LEAST_MM = 1e-5  # 10 nm: smaller distances have no optical meaning
_PLANES = {0.0: (ORANGE, "C 0 – C 180"), 90.0: (BLUE, "C 90 – C 270")}
_RINGS = 3  # of the polar diagram: their values fit
_ROUND = (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
_FURTHER = 1.25  # of the field angle: what the isocandela diagram shows beyond it
_SHOWN_HEIGHTS = 6.0  # mounting heights to each side: "very long" lies beyond
_PIXELS = 241
_DIAGONAL = 0.5**0.5  # between the labels of C


@in_report_style
def polar_diagram(photometry: Photometry) -> Figure:
    """Intensity over gamma in the principal planes, gamma = 0 downwards, as data sheets have it."""
    figure, axes = new_figure(NARROW, 0.68 * NARROW)
    profiles = {c_deg: plane_profile(table_of(photometry), c_deg) for c_deg in _PLANES}
    largest = max(float(values.max()) for _, values in profiles.values()) or 1.0
    rings = [level for level in MaxNLocator(_RINGS, steps=_ROUND).tick_values(0.0, largest) if level > 0.0]
    top = float(rings[-1])
    for radius in rings:
        _ring(axes, radius, from_deg=180.0)
        axes.text(radius, 0.02 * top, number(radius, 3), fontsize=7.0, ha="center", va="bottom")
    for degrees in range(-90, 91, 30):
        angle = np.deg2rad(degrees)
        axes.plot([0.0, top * np.sin(angle)], [0.0, -top * np.cos(angle)], color=GREY, linewidth=0.4)
        level = abs(degrees) == 90  # the values of the rings stand above that line
        x, y = 1.08 * top * np.sin(angle), -1.08 * top * np.cos(angle) - 0.02 * top * level
        axes.text(x, y, f"{abs(degrees)}°", fontsize=7.0, ha="center", va="top" if level else "center")
    for c_deg, (colour, name) in _PLANES.items():
        gamma, values = profiles[c_deg]
        angle = np.deg2rad(gamma)
        axes.plot(values * np.sin(angle), -values * np.cos(angle), color=colour, label=name)
    axes.set(aspect="equal", xlim=(-1.18 * top, 1.18 * top), ylim=(-1.18 * top, 0.12 * top))
    axes.set_axis_off()
    figure.legend(loc="outside upper center", ncols=2)
    return figure


@in_report_style
def isocandela_diagram(photometry: Photometry) -> Figure:
    """Lines of equal intensity over C, counted counterclockwise from the right, and gamma from the centre."""
    figure, axes = new_figure(NARROW, NARROW)
    reach = _reach(photometry)
    x, y = np.meshgrid(*2 * [np.linspace(-reach, reach, _PIXELS)])
    light = _at(table_of(photometry), np.rad2deg(np.arctan2(y, x)), np.hypot(x, y))
    levels = [share * photometry.peak_cd.value for share in ISO_SHARES]
    colours = list(ISO_SHARES.values())
    axes.contour(x, y, light, levels=levels, colors=colours, linewidths=0.9)
    for (share, colour), level in zip(ISO_SHARES.items(), levels, strict=True):
        axes.plot([], [], color=colour, label=f"{number(level, 3)} cd ({percent(share, 0)})")
    for radius in _round_angles(reach):
        _ring(axes, radius)
        axes.text(radius * _DIAGONAL, -radius * _DIAGONAL, f"{radius:g}°", fontsize=7.0, ha="center", va="center")
    for c_deg in (0, 90, 180, 270):
        turn = np.deg2rad(c_deg)
        axes.text(reach * np.cos(turn), reach * np.sin(turn), f"C {c_deg}", fontsize=7.0, ha="center", va="center")
    axes.set(aspect="equal", xlim=(-1.08 * reach, 1.08 * reach), ylim=(-1.08 * reach, 1.08 * reach))
    axes.set_axis_off()
    figure.legend(loc="outside lower center", ncols=3, fontsize=7.0)
    return figure


@in_report_style
def ground_diagram(photometry: Photometry, street_deg: float, lenses: int, height_m: float | None) -> Figure:
    """Illuminance on the ground under one lamp, over places in mounting heights, the street upwards.

    In lux at ``height_m``, or where there is none as a share of the largest.
    """
    figure, axes = new_figure(NARROW, NARROW)
    along, across = np.meshgrid(*2 * [np.linspace(-_SHOWN_HEIGHTS, _SHOWN_HEIGHTS, _PIXELS)])
    away = np.hypot(along, across)
    lateral = np.rad2deg(np.arctan2(along, across))
    c_deg = -(lateral + street_deg)  # the file counts C the other way than the lens its azimuth
    light = lenses * _at(table_of(photometry), c_deg, np.rad2deg(np.arctan(away))) / (1.0 + away**2) ** 1.5
    scale, unit = (1.0 / float(light.max()), "of the maximum") if height_m is None else (height_m**-2, "lx")
    top = float(scale * light.max())
    for share, colour in zip((0.01, 0.05, 0.2, 0.5), ("#6a4fc4", "#2f7fd1", "#1f9e89", "#d18a1f"), strict=True):
        axes.contour(along, across, scale * light, levels=[share * top], colors=[colour], linewidths=0.9)
        label = f"{percent(share, 0)} {unit}" if height_m is None else f"{number(share * top, 2)} {unit}"
        axes.plot([], [], color=colour, label=label)
    axes.axhline(0.0, color=INK, linewidth=0.5)
    axes.set(aspect="equal", xlabel="along the road (mounting heights)", ylabel="towards the street")
    axes.grid(True)
    figure.legend(loc="outside upper center", ncols=4, fontsize=7.0)
    return figure


def table_of(photometry: Photometry) -> TabulatedIntensity:
    """Intensities of the files, in their frame."""
    return TabulatedIntensity(photometry.c_deg, photometry.gamma_deg, photometry.candela)


def _at(
    table: TabulatedIntensity, c_deg: Float[np.ndarray, "n n"], gamma_deg: Float[np.ndarray, "n n"]
) -> Float[np.ndarray, "n n"]:
    from scipy.interpolate import RegularGridInterpolator

    read = RegularGridInterpolator((table.c_deg, table.gamma_deg), table.values, bounds_error=False, fill_value=0.0)
    return read(np.stack([c_deg % 360.0, gamma_deg], axis=-1))


def _reach(photometry: Photometry) -> float:
    """Angle (deg) that the isocandela diagram shows: somewhat more than half the wider field angle."""
    widths = [
        beam.field_angle_deg.value
        for beam in (photometry.beam_c0, photometry.beam_c90)
        if beam.field_angle_deg is not None
    ]
    return min(90.0, _FURTHER * 0.5 * max(widths, default=180.0))


def _round_angles(reach: float) -> list[float]:
    step = next(step for step in (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0) if reach / step <= 4.5 or step == 30.0)
    return [float(angle) for angle in np.arange(step, reach, step)]


def _ring(axes: Axes, radius: float, from_deg: float = 0.0) -> None:
    turn = np.deg2rad(np.linspace(from_deg, 360.0, 181))
    axes.plot(radius * np.cos(turn), radius * np.sin(turn), color=GREY, linewidth=0.4)


_HEIGHT = 2.6
_FAR = 1.5  # of the width of the distribution: a bound farther away would squeeze it
_BARS = 8
_BAR_HEIGHT = 0.24  # inches


@in_report_style
def distribution(
    values: Float[np.ndarray, " n"], designed: float, bounds: Sequence[MetricBound], label: str, *, share: bool
) -> Figure:
    """Share of the parts with at most the value on the axis, the value as designed, and the bounds.

    The wrong side of a bound is red. A bound or a designed value far from all parts is left out: see :func:`beyond`.
    """
    figure, axes = new_figure(NARROW, _HEIGHT)
    ordered = np.sort(values)
    axes.step(ordered, 100.0 * np.arange(1, len(values) + 1) / len(values), where="post", color=BLUE, label="parts")
    near = [bound.bound for bound in bounds if not beyond(values, bound.bound)]
    if not beyond(values, designed):
        axes.axvline(designed, color=INK, linewidth=1.0, linestyle=DASHED, label="as designed")
        near.append(designed)
    ends = np.array([*ordered[[0, -1]], *near])
    margin = 0.04 * float(np.ptp(ends)) or 0.01 * abs(float(ends[0])) or 1.0
    left = float(ends.min()) - margin
    right = float(ends.max()) + margin
    for index, near_bound in enumerate(bound for bound in bounds if not beyond(values, bound.bound)):
        wrong = (near_bound.bound, right) if near_bound.sense == "<=" else (left, near_bound.bound)
        axes.axvspan(*wrong, color=RED, alpha=0.1, linewidth=0.0)
        axes.axvline(near_bound.bound, color=RED, label="bound" if index == 0 else None)
    axes.set(xlim=(left, right), ylim=(0.0, 101.0), xlabel=label, ylabel="cumulative share of the parts (%)")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    if share:
        axes.xaxis.set_major_formatter(PercentFormatter(1.0, symbol=" %"))
    axes.grid(True)
    figure.legend(loc="outside upper left", ncols=3, handlelength=1.3)
    return figure


def beyond(values: Float[np.ndarray, " n"], value: float) -> bool:
    """True for a value that lies much farther from the parts than these from each other."""
    low = float(values.min())
    high = float(values.max())
    reach = _FAR * (high - low)
    return not low - reach <= value <= high + reach


@in_report_style
def cause_bars(variance: Variance) -> Figure:
    """The certain shares of a metric's variance and that of several tolerances together, with standard errors."""
    causes = variance.certain[:_BARS]
    names = [*(cause.words for cause in causes), TOGETHER]
    values = 100.0 * np.array([*(cause.share for cause in causes), variance.interactions.value])
    errors = 100.0 * np.array(
        [*(cause.standard_error for cause in causes), variance.interactions.standard_error or 0.0]
    )
    figure, axes = new_figure(WIDE, 0.6 + _BAR_HEIGHT * len(names))
    colours = [BLUE] * len(causes) + [GREY]
    axes.barh(np.arange(len(names)), values, xerr=errors, color=colours, ecolor=INK, error_kw={"elinewidth": 0.8})
    axes.set_yticks(np.arange(len(names)), names)
    axes.invert_yaxis()
    axes.set(xlabel="share of the variance (%)")
    axes.axvline(0.0, color=INK, linewidth=0.6)
    axes.grid(True, axis="x")
    return figure


@in_report_style
def gap_figure(
    gaps_mm: Mapping[str, Float[np.ndarray, " q"]], limit_mm: float | None, *, far_field: bool = False
) -> Figure:
    """Cumulative share of the rays over the gap; ``gaps_mm``: by name of the referee, quantiles evenly from 0 to 1.

    ``limit_mm``: the largest rms gap allowed for the exported mesh, dashed. Gaps of directions are those at 1 m.
    """
    figure, axes = new_figure(WIDE, 3.1)
    for (name, quantiles), colour in zip(gaps_mm.items(), _GAP_COLOURS, strict=False):
        share = np.linspace(0.0, 1.0, len(quantiles))
        axes.plot(np.maximum(quantiles, _LEAST_MM), share, color=colour, label=name)
    if limit_mm is not None:
        axes.axvline(limit_mm, color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label="limit of the mesh's rms")
    label = "ray displacement (mm{})".format(" at 1 m" if far_field else "")
    axes.set(xscale="log", xlabel=label, ylabel="share of the rays", ylim=(0, 1.02))
    low = min(float(quantiles[len(quantiles) // 50]) for quantiles in gaps_mm.values())
    axes.set_xlim(left=max(low, _LEAST_MM))
    axes.xaxis.set_major_locator(LogLocator(numticks=8))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    axes.grid(True)
    figure.legend(loc="outside upper left", ncols=2, handlelength=1.3, columnspacing=1.0)
    return figure
