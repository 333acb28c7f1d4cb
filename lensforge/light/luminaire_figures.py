"""Figures by which lamps are chosen: how far a torch reaches, and what share of the light falls where in a room."""

from typing import Annotated

import numpy as np

from lensforge.results import Metric, Record
from lensforge.results.figure import Figure, figure

_REACHED_LX = 0.25  # about that of the full moon: ANSI/PLATO FL1


class LuminaireFigures(Record):
    """Figures of the light in the files.

    ``throw``: distance at which the peak intensity makes 0.25 lx; None if lumens are not known. ``flux_code``: N1 to N5
    as shares: of the downward flux in cones of solid angles pi/2, pi and 3 pi/2, of all flux downwards, and of the
    source's flux in the files. ``direct_ratios``: share of the flux that falls straight on the working plane of a
    square room, for the room indices 0.6, 0.8, 1, 1.25, 1.5, 2, 2.5, 3, 4 and 5.
    """

    throw: Annotated[Metric | None, Figure("Throw", "0.25 lx there by the peak intensity, ANSI/PLATO FL1", key="throw")]
    flux_code: tuple[Metric, Metric, Metric, Metric, Metric]
    direct_ratios: tuple[Metric, ...]

    @property
    @figure(Figure("CEN flux code", "N1 to N5 in per cent, EN 13032-2", key="flux_code"))
    def flux_code_words(self) -> str:
        """The flux code as printed in data sheets."""
        return " ".join(f"{100.0 * share.value:.0f}" for share in self.flux_code)


def throw_of(peak_cd: Metric) -> Metric:
    """Distance (m) at which this intensity makes 0.25 lx."""
    throw = float(np.sqrt(max(peak_cd.value, 0.0) / _REACHED_LX))
    error = peak_cd.standard_error
    if error is not None:
        error = error / (2.0 * _REACHED_LX * throw) if throw > 0.0 else float(np.sqrt(error / _REACHED_LX))
    return Metric(value=throw, unit="m", standard_error=error)
