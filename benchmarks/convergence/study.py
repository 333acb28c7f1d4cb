"""Convergence studies: one setting at several refinement levels, each with its cost and its error."""

import time
import tracemalloc
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.results import Flag, Metric, Number, Record, Text

Setting = Annotated[int, Field(strict=True)] | Number
Errors = dict[Text, Metric]


class RefinementLevel(Record):
    """One value of the setting.

    ``series``: the method, where a study compares several. ``seconds``: of one run, on the threads in use. ``peak_mb``:
    the largest amount that NumPy held at once during it. ``errors``: by name, against the study's reference; without a
    standard error where it is a maximum over fixed points. ``used_by``: the presets and stages with this setting.
    """

    setting: Setting
    series: Text
    seconds: Number | None
    peak_mb: Number | None
    errors: Errors
    used_by: tuple[Text, ...] = ()
    other: dict[Text, Setting] = Field(default_factory=dict)
    reference: Flag = False


class ConvergenceStudy(Record):
    """The refinement levels of one setting; ``knob``: its field or option.

    ``order``: by series, the power of the setting with which an error changes. ``plotted``: the errors to plot,
    ``against`` time or the setting.
    """

    name: Text
    title: Text
    knob: Text
    reference: Text
    levels: tuple[RefinementLevel, ...]
    order: dict[Text, Errors] = Field(default_factory=dict)
    plotted: tuple[Text, ...]
    against: Literal["seconds", "setting"]

    @property
    def units(self) -> dict[str, str]:
        """The unit of each error; "" for a ratio."""
        return {name: error.unit for name, error in self.levels[0].errors.items()}


class Meter:
    """Seconds and peak memory (MB, as NumPy allocates it) of a ``with`` block.

    Seconds are the lesser of wall and processor time: on one thread, that excludes the load of other programs.
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

    def level(
        self, setting: float, series: str, errors: Errors, used_by: tuple[str, ...] = (), **other: Setting
    ) -> RefinementLevel:
        """The refinement level that was measured in this block."""
        return RefinementLevel(
            setting=setting,
            series=series,
            seconds=self.seconds,
            peak_mb=self.peak_mb,
            errors=errors,
            used_by=used_by,
            other=other,
        )


def reference_level(series: str, units: Mapping[str, str], cost: Meter | None = None) -> RefinementLevel:
    """The reference itself, as a level without errors; ``units`` are those of the study's errors."""
    seconds, peak_mb = (None, None) if cost is None else (cost.seconds, cost.peak_mb)
    errors = {name: Metric(value=0.0, unit=unit) for name, unit in units.items()}
    return RefinementLevel(setting=0, series=series, seconds=seconds, peak_mb=peak_mb, errors=errors, reference=True)


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


def orders_of(levels: Sequence[RefinementLevel], names: tuple[str, ...]) -> Errors:
    """The order of each of the errors ``names``, where three or more of the levels exceed twice their noise."""
    found = {}
    for name in names:
        kept = [
            level
            for level in levels
            if not level.reference and level.errors[name].value > 2.0 * (level.errors[name].standard_error or 0.0)
        ]
        if len(kept) < 3:
            continue
        values = np.array([level.errors[name].value for level in kept])
        noise = [level.errors[name].standard_error for level in kept]
        known = None if None in noise else np.array(noise, dtype=np.float64) / values
        found[name] = order_of(np.array([level.setting for level in kept]), values, known)
    return found
