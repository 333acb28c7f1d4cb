"""What a ladder is: one knob, its rungs, and for each rung what it costs and how far it is from the reference."""

import time
import tracemalloc
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Estimate:
    """A measured number and its standard error; None where it is no estimate but a maximum over fixed points."""

    value: float
    standard_error: float | None = None


@dataclass(frozen=True)
class Rung:
    """One setting of a knob.

    ``series``: which of the ladder's methods. ``seconds``: of one run, on the threads in use. ``peak_mb``: the most
    that NumPy held at once during it. ``errors``: by name, against the ladder's reference. ``presets``: who uses it.
    """

    setting: float
    series: str
    seconds: float | None
    peak_mb: float | None
    errors: dict[str, Estimate]
    presets: tuple[str, ...] = ()
    other: Mapping[str, float] = field(default_factory=dict)
    reference: bool = False

    def to_json(self) -> dict[str, Any]:
        """For ``tradeoff.json``."""
        return {
            "setting": self.setting,
            "series": self.series,
            "seconds": self.seconds,
            "peak_mb": self.peak_mb,
            "error": {name: estimate.value for name, estimate in self.errors.items()},
            "standard_error": {name: estimate.standard_error for name, estimate in self.errors.items()},
            "presets": list(self.presets),
            **self.other,
            "reference": self.reference,
        }


@dataclass(frozen=True)
class Ladder:
    """The rungs of one knob. ``plotted``: the errors that are drawn against time, or against the setting."""

    name: str
    title: str
    knob: str
    reference: str
    units: dict[str, str]
    plotted: tuple[str, ...]
    against: str  # "seconds" or "setting"
    rungs: tuple[Rung, ...]
    orders: dict[str, dict[str, Estimate]] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """For ``tradeoff.json``; ``order`` is the power of the setting with which an error changes."""
        return {
            "title": self.title,
            "knob": self.knob,
            "reference": self.reference,
            "unit": self.units,
            "order": {
                series: {name: vars(order) for name, order in found.items()} for series, found in self.orders.items()
            },
            "rows": [rung.to_json() for rung in self.rungs],
        }


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
) -> Estimate:
    """The power of ``settings`` with which ``errors`` change: the slope of a line through their logarithms.

    Its standard error comes from the ``relative`` standard errors of the points, or else from their scatter.
    """
    x, y = np.log(settings), np.log(errors)
    away = x - x.mean()
    slope = float(away @ y / (away @ away))
    if relative is not None:
        return Estimate(slope, float(np.sqrt(away**2 @ relative**2) / (away @ away)))
    rest = y - y.mean() - slope * away
    freedom = len(x) - 2
    return Estimate(slope, float(np.sqrt(rest @ rest / freedom / (away @ away))) if freedom > 0 else None)


def orders_of(rungs: list[Rung], names: tuple[str, ...]) -> dict[str, Estimate]:
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
