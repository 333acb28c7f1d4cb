"""Flux budget as a waterfall: the emitted flux minus every loss is the detected flux."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from lensforge.light.receiver_light import Flux, MissedByCause
from lensforge.report.figure_style import BLUE, GREEN, NARROW, ORANGE, in_report_style, new_figure

_WORDS = {
    "backward": "emitted backwards",
    "outside_cavity": "started outside the cavity",
    "base": "hit the base",
    "missed_receiver": "missed the receiver",
    "surfaces_intersect": "met intersecting surfaces",
    "total_reflection": "totally reflected",
    "not_converged": "not converged",
    "absorbed": "absorbed in the lens",
    "reflected": "reflected at the surfaces",
    "cover_glass": "lost in the cover glass",
    "outside": "landed outside the window",
}


def losses(flux: Flux, missed: MissedByCause) -> list[tuple[str, float]]:
    """Every loss above zero as (words, share of the emitted flux), in the order in which they occur along a ray."""
    shares = {**missed.model_dump(), **flux.model_dump()}
    return [(words, shares[name]) for name, words in _WORDS.items() if shares[name] > 0.0]


def flux_budget(flux: Flux, missed: MissedByCause) -> Figure:
    """A waterfall from the emitted flux through each loss to the detected flux; shares of the emitted flux."""
    return waterfall(losses(flux, missed), [("detected", flux.detected)])


@in_report_style
def waterfall(lost: Sequence[tuple[str, float]], kept: Sequence[tuple[str, float]]) -> Figure:
    """A bar for the emitted flux, one for each share of it that is ``lost``, one for each that is ``kept``.

    Both as (words, share of the emitted flux). Bars of ``kept`` stand end to end from 0.
    """
    count = len(lost) + len(kept)
    figure, axes = new_figure(NARROW, max(2.75, 0.55 + 0.4 * (count + 1)))
    left = 1.0
    _bar(axes, 0, "emitted", 0.0, 1.0, BLUE)
    for row, (label, share) in enumerate(lost, start=1):
        left -= share
        _bar(axes, row, label, left, share, ORANGE)
    left = 0.0
    for row, (label, share) in enumerate(kept, start=len(lost) + 1):
        _bar(axes, row, label, left, share, GREEN)
        left += share
    axes.set(xlim=(0.0, 1.0), ylim=(count + 0.45, -0.75), yticks=[], xlabel="share of the emitted flux")
    axes.spines["left"].set_visible(False)
    axes.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    axes.grid(True, axis="x")
    axes.set_axisbelow(True)
    return figure


def _bar(axes: Axes, row: int, label: str, left: float, width: float, colour: str) -> None:
    """One bar; its label and share are above it, where they fit whatever its width."""
    axes.barh(row + 0.16, width, left=left, height=0.42, color=colour, linewidth=0)
    axes.text(0.0, row - 0.12, label, ha="left", va="bottom")
    share = "< 0.01 %" if 0.0 < width < 5e-5 else f"{100.0 * width:.2f} %"
    axes.text(1.0, row - 0.12, share, ha="right", va="bottom")
