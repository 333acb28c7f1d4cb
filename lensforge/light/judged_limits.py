"""Limits judged by the deciding figure of each, read from the light and corrected for the bias of noise."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.light.beam_colour import distances_left_out
from lensforge.light.receiver_light import ReceiverLight
from lensforge.results import Fact, Metric
from lensforge.results.estimates import jackknife_metric, with_error
from lensforge.scene.intensity_limit import IntensityLimit
from lensforge.scene.limit_readings import LightLimit, LightReading
from lensforge.spec.light_limits import ColourSection
from lensforge.spec.quantities import Readings, extreme

_OF_PIXELS = 1.0 / 3.0
_NO_COLOUR = Metric(value=1.0, standard_error=0.0)  # differences in the dark: larger than any in u', v'


def judged_limits(
    limits: Sequence[LightLimit],
    images: Sequence[Float[np.ndarray, "_ _ _"]],
    names: Sequence[str],
    losses: Sequence[Float[np.ndarray, "_ _"]] = (),
    shares: Sequence[Float[np.ndarray, "_ _"]] = (),
) -> tuple[Fact, ...]:
    """Judge ``limits`` on the filtered pictures of flux (W) of every replicate, one stack for each receiver.

    ``losses``: flux (W) by cause of its loss, ``shares``: of the flux in each zone of a limit on it, likewise.
    """
    in_zones = [iter(share.T) for share in shares]

    def value(limit: LightLimit) -> Metric:
        if limit.region is not None and shares:
            return jackknife_metric(next(in_zones[limit.receiver]), float)
        return limit_value(limit, (losses if limit.quantity.of_losses else images)[limit.receiver])

    return tuple(judged(limit, names[limit.receiver], value(limit)) for limit in limits)


def judged(limit: LightLimit | IntensityLimit, receiver: str, value: Metric) -> Fact:
    """The limit judged on ``receiver``, or under the name of an application's class.

    ``value``: at the deciding place, the one with the least or the most light.
    """
    given: dict[str, Any] = {"sense": limit.sense, "limit": float(limit.bound), "place": receiver}
    fact = Fact.measured(limit.name, limit.name, value, limit.quantity.phrase, **given)
    return replace(fact, unit=limit.unit)


def stated_figures(
    readings: Sequence[LightReading], images: Sequence[Float[np.ndarray, "_ _ _"]], names: Sequence[str]
) -> Iterator[Fact]:
    """Figures of the filtered pictures of flux (W) of every replicate, one stack for each receiver."""
    for reading in readings:
        value = limit_value(reading, images[reading.receiver])
        fact = Fact.measured(reading.name, reading.name, value, reading.quantity.phrase, place=names[reading.receiver])
        yield replace(fact, unit=reading.unit)


def colour_limits(section: ColourSection | None, lit: Sequence[ReceiverLight]) -> Iterator[Fact]:
    """Judge the limits on the colour on each receiver; in the dark each fails."""
    if section is None:
        return
    for receiver in lit:
        for figure, bound in section.bounds.items():
            name = f"Δu′v′ {figure} {BEAMS[section.within]}"
            value = _NO_COLOUR if receiver.colour is None else getattr(receiver.colour, figure)
            quantity = "distance from the mean colour"
            fact = Fact.measured(name, name, value, quantity, limit=bound, place=receiver.name)
            yield replace(fact, remedy=_OF_COLOUR) if fact.state == "fail" else fact


def colours_left_out(
    section: ColourSection | None, pictures: Float[np.ndarray, "c r h w"]
) -> Iterator[Float[np.ndarray, " v"]]:
    """Each limited figure of the colour on one receiver: by all replicates, then with each left out in turn.

    ``pictures``: X, Y and Z; empty if colour has no limits.
    """
    if section is None:
        return
    distances = distances_left_out(pictures, section.level)
    for bound in section.bounds:
        yield np.array([(_NO_COLOUR if distance is None else distance[bound]).value for distance in distances])


_OF_COLOUR = "take a larger lens, a softer edge of the target, or a face that scatters"
BEAMS = {"fwhm": "within half of the peak", "tenth": "within a tenth of the peak"}


def limit_value(limit: LightReading, images: Float[np.ndarray, "r *_"]) -> Metric:
    """The deciding value, in the limit's unit.

    The value of a spot is a mean over pixels of rays that pass beside the eye: its error includes a third of the change
    for half as many pixels, about the change for infinitely many, and the square of the blur's angle.
    """
    value = _value(limit, limit.of(images), images)
    if limit.coarser is None or value.standard_error is None:
        return value
    coarse = extreme((limit.coarser @ images.reshape(len(images), -1).T).T, limit.sense)
    more = np.hypot(_OF_PIXELS * (value.value - coarse.value), limit.blurred * value.value)
    return with_error(value, float(more))


def values_left_out(
    limit: LightReading, read: Float[np.ndarray, "k r"], images: Float[np.ndarray, "r *_"]
) -> Float[np.ndarray, " v"]:
    """The deciding value by all replicates, then with each left out in turn; of a single replicate only the value.

    ``read``: readings of ``limit`` for each of the ``images``.
    """
    numbers = np.arange(len(images))
    values = []
    for rows in (numbers, *(numbers[numbers != k] for k in numbers if len(numbers) > 1)):
        readings = np.take(read, rows, axis=1).T
        values.append(_value(limit, readings, images[rows] if limit.quantity.of_whole else readings).value)
    return np.array(values)


def means_left_out(replicates: Float[np.ndarray, " r"]) -> Float[np.ndarray, " v"]:
    """Mean of ``replicates``, then with each left out in turn; of a single replicate only the mean."""
    count = len(replicates)
    total = replicates.sum()
    left_out = (total - replicates) / (count - 1) if count > 1 else replicates[:0]
    return np.array([total / count, *left_out])


def _value(limit: LightReading, readings: Readings, images: Float[np.ndarray, "r *_"]) -> Metric:
    whole = limit.whole(images.reshape(len(images), -1))
    return limit.quantity.value(readings, limit.sense, limit.unit, whole)
