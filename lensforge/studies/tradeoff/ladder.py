"""What a ladder is: one knob, its rungs, and for each rung what it costs and how far it is from the reference."""

import time
import tracemalloc
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.records import Flag, Metric, Number, Record, Text

Setting = Annotated[int, Field(strict=True)] | Number
Errors = dict[Text, Metric]


class Rung(Record):
    """One setting of a knob.

    ``series``: which of the ladder's methods. ``seconds``: of one run, on the threads in use. ``peak_mb``: the most
    that NumPy held at once during it. ``errors``: by name, against the ladder's reference; no standard error where it
    is a maximum over fixed points. ``presets``: who uses it.
    """

    setting: Setting
    series: Text
    seconds: Number | None
    peak_mb: Number | None
    errors: Errors
    presets: tuple[Text, ...] = ()
    other: dict[Text, Setting] = Field(default_factory=dict)
    reference: Flag = False


class Ladder(Record):
    """The rungs of one knob, in ``rows``.

    ``order``: by series, the power of the setting with which an error changes. ``plotted``: the errors that are drawn,
    ``against`` time or the setting.
    """

    name: Text
    title: Text
    knob: Text
    reference: Text
    rows: tuple[Rung, ...]
    order: dict[Text, Errors] = Field(default_factory=dict)
    plotted: tuple[Text, ...]
    against: Literal["seconds", "setting"]

    @property
    def units(self) -> dict[str, str]:
        """The unit of each error; "" for a ratio."""
        return {name: error.unit for name, error in self.rows[0].errors.items()}


def exactly(units: Mapping[str, str]) -> Errors:
    """The errors of a reference itself: none."""
    return {name: Metric(value=0.0, unit=unit) for name, unit in units.items()}


class Meter:
    """Seconds and peak memory (MB, what NumPy allocates) of a ``with`` block.

    The lesser of the time on the wall and that of the processors: on one thread what other programs take is left out.
    """

    seconds = 0.0
    peak_mb = 0.0

    def __enter__(self) -> "Meter":
        self._outermost = not tracemalloc.is_tracing()
        if self._outermost:
            tracemalloc.start(1)
        tracemalloc.reset_peak()
        self._held = tracemalloc.get_traced_memory()[0]
        self._started = time.perf_counter(), time.process_time()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        wall, processors = self._started
        self.seconds = min(time.perf_counter() - wall, time.process_time() - processors)
        self.peak_mb = (tracemalloc.get_traced_memory()[1] - self._held) / 1e6
        if self._outermost:
            tracemalloc.stop()


def order_of(
    settings: Float[np.ndarray, " n"], errors: Float[np.ndarray, " n"], relative: Float[np.ndarray, " n"] | None = None
) -> Metric:
    """The power of ``settings`` with which ``errors`` change: the slope of a line through their logarithms.

    Its standard error comes from the ``relative`` standard errors of the points, or else from their scatter.
    """
    x, y = np.log(settings), np.log(errors)
    away = x - x.mean()
    slope = float(away @ y / (away @ away))
    if relative is not None:
        return Metric(value=slope, standard_error=float(np.sqrt(away**2 @ relative**2) / (away @ away)))
    rest = y - y.mean() - slope * away
    freedom = len(x) - 2
    scatter = float(np.sqrt(rest @ rest / freedom / (away @ away))) if freedom > 0 else None
    return Metric(value=slope, standard_error=scatter)


def orders_of(rungs: Sequence[Rung], names: tuple[str, ...]) -> Errors:
    """The order of each of the errors ``names`` over ``rungs``, where three or more stand out of their noise."""
    found = {}
    for name in names:
        kept = [
            rung
            for rung in rungs
            if not rung.reference and rung.errors[name].value > 2.0 * (rung.errors[name].standard_error or 0.0)
        ]
        if len(kept) < 3:
            continue
        values = np.array([rung.errors[name].value for rung in kept])
        noise = [rung.errors[name].standard_error for rung in kept]
        known = None if None in noise else np.array(noise, dtype=np.float64) / values
        found[name] = order_of(np.array([rung.setting for rung in kept]), values, known)
    return found
