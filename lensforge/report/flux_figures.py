"""Where the light went: what is emitted, less each loss, is what arrives."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from lensforge.report.drawing import BLUE, GREEN, NARROW, ORANGE, in_house_style, new_figure

_WORDS = {
    "absorbed_fresnel": "reflected at the surfaces",
    "missed": "missed the lens",
    "backward": "emitted backwards",
    "outside_cavity": "started outside the cavity",
    "base": "ran into the base",
    "averted": "left away from the receiver",
    "crossed": "met crossed surfaces",
    "no_hit": "met no surface",
    "starts_inside": "started inside the lens",
    "back_into_cavity": "ran back into the cavity",
    "total_reflection": "totally reflected",
    "not_converged": "not converged",
    "outside": "landed outside the window",
    "detected": "detected",
}


def losses(flux: Mapping[str, float], missed_by_cause: Mapping[str, float]) -> list[tuple[str, float]]:
    """(what happened, share of the emitted flux) of every loss above zero, in the order in which light meets them."""
    causes = missed_by_cause if missed_by_cause else {"missed": flux.get("missed", 0.0)}
    shares = {
        **causes,
        "total_reflection": flux.get("total_reflection", 0.0),
        "not_converged": flux.get("not_converged", 0.0),
        "absorbed_fresnel": flux.get("absorbed_fresnel", 0.0),
        "outside": flux.get("outside", 0.0),
    }
    return [(_WORDS.get(name, name.replace("_", " ")), share) for name, share in shares.items() if share > 0.0]


def flux_account(flux: Mapping[str, float], missed_by_cause: Mapping[str, float]) -> Figure:
    """A waterfall from the emitted flux through each loss to the detected flux; shares of the emitted flux."""
    return waterfall(losses(flux, missed_by_cause), [(_WORDS["detected"], flux.get("detected", 0.0))])


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
