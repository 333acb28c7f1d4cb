"""The part of a receiver that a picture frames: where light is wanted, and where much of it lands."""

import numpy as np
from jaxtyping import Bool, Float

from lensforge.results import Image
from lensforge.results.chart import Chart

_WANTED, _LANDED = 0.01, 0.05  # of the target's peak: darker places need not be seen
_MARGIN = 1.2  # of the frame over what it holds
_WORTH = 0.85  # of the receiver's sides: a frame that cuts less away is no gain
_FLATTEST = 0.5  # height over width; at most it is 1, where the receiver is wide enough


def lit_frame(target: Image, reached: Image, chart: Chart) -> Chart:
    """The centred part of ``chart`` that holds the target and its light; ``chart`` itself where that is most of it.

    ``target``, ``reached``: [row y, column x] on ``chart``, in the same unit.
    """
    peak = float(target.max())
    lit = (target > _WANTED * peak) | (reached > _LANDED * peak)
    if not peak > 0.0 or not lit.any():
        return chart
    rows, columns = lit.shape
    wide = _MARGIN * _reach(chart.x(columns), np.asarray(lit.any(axis=0)), chart.width / columns)
    high = _MARGIN * _reach(chart.y(rows), np.asarray(lit.any(axis=1)), chart.height / rows)
    width, height = min(chart.width, max(wide, high)), min(chart.height, max(high, _FLATTEST * wide))
    if width > _WORTH * chart.width and height > _WORTH * chart.height:
        return chart
    return Chart(width, height, chart.far_field)


def _reach(centres: Float[np.ndarray, " k"], lit: Bool[np.ndarray, " k"], pitch: float) -> float:
    """Length, centred, that holds the ``lit`` pixels."""
    return 2.0 * float(np.abs(centres[lit]).max()) + pitch
