"""Where the light went: what is emitted, less each loss, is what arrives."""

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from lensforge.report.drawing import BLUE, GREEN, INK, ORANGE, WIDE, in_house_style, new_figure

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


@in_house_style
def flux_account(flux: Mapping[str, float], missed_by_cause: Mapping[str, float]) -> Figure:
    """A waterfall from the emitted flux through each loss to the detected flux; shares of the emitted flux."""
    lost = losses(flux, missed_by_cause)
    figure, axes = new_figure(WIDE, 0.75 + 0.3 * (len(lost) + 2))
    left, labels = 1.0, ["emitted"]
    _bar(axes, 0, 0.0, 1.0, BLUE)
    for row, (label, share) in enumerate(lost, start=1):
        left -= share
        _bar(axes, row, left, share, ORANGE)
        labels.append(label)
    _bar(axes, len(labels), 0.0, flux.get("detected", 0.0), GREEN)
    labels.append(_WORDS["detected"])
    axes.set_yticks(range(len(labels)), labels)
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set(xlim=(0.0, 1.0), xlabel="share of the emitted flux")
    axes.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    axes.grid(True, axis="x")
    axes.set_axisbelow(True)
    return figure


def _bar(axes: Axes, row: int, left: float, width: float, colour: str) -> None:
    """One bar, its number where there is room: inside a wide bar, else on the side away from the edge."""
    axes.barh(row, width, left=left, height=0.62, color=colour, linewidth=0)
    text, end = f"{100.0 * width:.2f} %", left + width
    if width > 0.2:
        axes.text(end - 0.012, row, text, ha="right", va="center", color="white")
    elif left > 0.5:
        axes.text(left - 0.012, row, text, ha="right", va="center", color=INK)
    else:
        axes.text(end + 0.012, row, text, ha="left", va="center", color=INK)
