"""Where the light went: what is emitted, less each loss, is what arrives."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from lensforge.evaluation.light import Flux, MissedByCause
from lensforge.report.drawing import BLUE, GREEN, NARROW, ORANGE, in_house_style, new_figure

_WORDS = {
    "backward": "emitted backwards",
    "outside_cavity": "started outside the cavity",
    "base": "ran into the base",
    "averted": "left away from the receiver",
    "crossed": "met crossed surfaces",
    "total_reflection": "totally reflected",
    "not_converged": "not converged",
    "absorbed_fresnel": "reflected at the surfaces",
    "outside": "landed outside the window",
}


def losses(flux: Flux, missed: MissedByCause) -> list[tuple[str, float]]:
    """(what happened, share of the emitted flux) of every loss above zero, in the order in which light meets them."""
    shares = {**missed.model_dump(), **flux.model_dump()}
    return [(words, shares[name]) for name, words in _WORDS.items() if shares[name] > 0.0]


def flux_account(flux: Flux, missed: MissedByCause) -> Figure:
    """A waterfall from the emitted flux through each loss to the detected flux; shares of the emitted flux."""
    return waterfall(losses(flux, missed), [("detected", flux.detected)])


@in_house_style
def waterfall(lost: Sequence[tuple[str, float]], kept: Sequence[tuple[str, float]]) -> Figure:
    """From all of the emitted flux through what is ``lost``, step by step, to what is ``kept``, side by side from 0.

    Both as (what it is, share of the emitted flux).
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
    """One bar, what it is and how much above it: there is room for it whatever the width of the bar."""
    axes.barh(row + 0.16, width, left=left, height=0.42, color=colour, linewidth=0)
    axes.text(0.0, row - 0.12, label, ha="left", va="bottom")
    share = "< 0.01 %" if 0.0 < width < 5e-5 else f"{100.0 * width:.2f} %"
    axes.text(1.0, row - 0.12, share, ha="right", va="bottom")
