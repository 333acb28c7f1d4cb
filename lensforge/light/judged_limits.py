"""Limits judged: the figure that decides on each, by readings of the light, without the noise that would choose it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.light.beam_colour import distances_left_out
from lensforge.light.metrics import (
    debiased_maximum,
    debiased_minimum,
    jackknife_metric,
    least_over_mean,
    ratio_of,
    scaled,
    with_error,
)
from lensforge.light.receiver_light import ReceiverLight
from lensforge.results import Fact, Metric, Sense
from lensforge.scene.intensity_limit import GlareLaw, IntensityLimit
from lensforge.scene.limit_readings import LightLimit
from lensforge.sources.intensity import width_above
from lensforge.spec.light_limits import ColourSection, Quantity

_OF_PIXELS = 1.0 / 3.0
DARK = 1e6  # glare where there is no light, and what is over light of 0
_NO_COLOUR = Metric(value=1.0, standard_error=0.0)  # differences in the dark: larger than any in u', v'
Readings = Float[np.ndarray, "r k"]


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
        return limit_value(limit, (losses if limit.of_losses else images)[limit.receiver])

    return tuple(judged(limit, names[limit.receiver], value(limit)) for limit in limits)


_QUANTITIES = {
    "light": "light",
    "relative": "light relative to its maximum",
    "min_over_mean": "min/mean of the light",
    "min_over_max": "min/max of the light",
    "share": "share of the flux",
    "loss": "lost share of the flux",
    "beam_angle": "beam angle",
    "luminance": "luminance of the brightest spot",
    "mean_luminance": "mean luminance over the outline",
    "ratio": "ratio of means",
    "mean_over_min": "mean/min of the light",
    "max_over_min": "max/min of the light",
}


def judged(limit: LightLimit | IntensityLimit, receiver: str, value: Metric) -> Fact:
    """The limit judged on ``receiver``, or what the class of an application of this name requires.

    ``value``: of the place that decides, that with the least light or the most.
    """
    given: dict[str, Any] = {"sense": limit.sense, "limit": float(limit.bound)}
    quantity = limit.quantity.name if isinstance(limit.quantity, GlareLaw) else _QUANTITIES[limit.quantity]
    return replace(Fact.measured(limit.name, limit.name, value, quantity, place=receiver, **given), unit=limit.unit)


def colour_limits(section: ColourSection | None, lit: Sequence[ReceiverLight]) -> Iterator[Fact]:
    """Judge the limits on the colour on each receiver; in the dark each is missed."""
    if section is None:
        return
    for receiver in lit:
        for words, bound in section.bounds.items():
            name = f"Δu′v′ {words} {BEAMS[section.within]}"
            value = _NO_COLOUR if receiver.colour is None else getattr(receiver.colour, words)
            quantity = "distance from the mean colour"
            fact = Fact.measured(name, name, value, quantity, limit=bound, place=receiver.name)
            yield replace(fact, remedy=_OF_COLOUR) if fact.state == "fail" else fact


def colours_left_out(
    section: ColourSection | None, pictures: Float[np.ndarray, "c r h w"]
) -> Iterator[Float[np.ndarray, " v"]]:
    """Each limited figure of the colour on one receiver: by all replicates, then with one after the other left out.

    ``pictures``: X, Y and Z; none where colour is not required.
    """
    if section is None:
        return
    distances = distances_left_out(pictures, section.level)
    for bound in section.bounds:
        yield np.array([(_NO_COLOUR if distance is None else distance[bound]).value for distance in distances])


_OF_COLOUR = "take a larger lens, a softer edge of the target, or a face that scatters"
BEAMS = {"fwhm": "within half of the peak", "tenth": "within a tenth of the peak"}


def limit_value(limit: LightLimit, images: Float[np.ndarray, "r *_"]) -> Metric:
    """The value that decides, in the limit's unit.

    That of a spot is a mean over pixels, by rays that pass beside the eye: its error has a third of what half as many
    pixels change, about as much as pixels without end would, and the square of the angle of the blur.
    """
    value = _value(limit, limit.of(images), images)
    if limit.coarser is None or value.standard_error is None:
        return value
    coarse = _extreme((limit.coarser @ images.reshape(len(images), -1).T).T, limit.sense)
    more = np.hypot(_OF_PIXELS * (value.value - coarse.value), limit.blurred * value.value)
    return with_error(value, float(more))


def values_left_out(
    limit: LightLimit, read: Float[np.ndarray, "k r"], images: Float[np.ndarray, "r *_"]
) -> Float[np.ndarray, " v"]:
    """The value that decides by all replicates, then with one after the other left out; of one replicate alone it.

    ``read``: what the readings of ``limit`` are of each of the ``images``.
    """
    numbers = np.arange(len(images))
    found = []
    for rows in (numbers, *(numbers[numbers != k] for k in numbers if len(numbers) > 1)):
        readings = np.take(read, rows, axis=1).T
        found.append(_value(limit, readings, images[rows] if limit.quantity == "relative" else readings).value)
    return np.array(found)


def means_left_out(replicates: Float[np.ndarray, " r"]) -> Float[np.ndarray, " v"]:
    """Mean of ``replicates``, then with one after the other left out; of one alone it."""
    count, total = len(replicates), replicates.sum()
    left_out = (total - replicates) / (count - 1) if count > 1 else replicates[:0]
    return np.array([total / count, *left_out])


def _value(limit: LightLimit, readings: Readings, images: Float[np.ndarray, "r *_"]) -> Metric:
    if limit.quantity == "beam_angle":
        return jackknife_metric(readings, lambda mean: beam_angle(limit, mean), limit.unit)
    if limit.quantity == "relative":
        whole = limit.light_per_flux * images.reshape(len(images), -1)
        return ratio_of(_extreme(readings, limit.sense), _extreme(whole, "<="))
    return figure_of(limit.quantity, limit.sense, limit.unit, readings)


def figure_of(quantity: Quantity | GlareLaw, sense: Sense, unit: str, readings: Readings) -> Metric:
    """The ``quantity`` of readings by every replicate, in ``unit``: all that needs no more than these."""
    match quantity:
        case "share" | "loss":
            return jackknife_metric(readings.sum(axis=1), float)
        case "min_over_mean":
            return least_over_mean(readings).metric()
        case "min_over_max":
            return ratio_of(_extreme(readings, ">="), _extreme(readings, "<="))
        case "ratio":
            return jackknife_metric(readings, lambda mean: float(mean[0] / mean[1]) if mean[1] > 0.0 else 0.0, unit)
        case "mean_over_min":
            return _inverse(least_over_mean(readings).metric())
        case "max_over_min":
            return _inverse(ratio_of(_extreme(readings, ">="), _extreme(readings, "<=")))
        case GlareLaw():
            return _glare(quantity, unit, readings)
    return _extreme(readings, sense).changed(unit=unit)


def _glare(law: GlareLaw, unit: str, readings: Readings) -> Metric:
    """Largest glare on the way; its error has in it that of the mean luminance, the last reading."""
    mean = jackknife_metric(readings[:, -1], float)
    if not mean.value > 0.0:
        return Metric(value=DARK, unit=unit, standard_error=0.0)
    factor, power = law.at(mean.value)
    glare = scaled(debiased_maximum(readings[:, :-1]), factor / mean.value**power, unit)
    return with_error(glare, power * glare.value * (mean.standard_error or 0.0) / mean.value)


def _inverse(ratio: Metric) -> Metric:
    if not ratio.value > 1.0 / DARK:
        return Metric(value=DARK, standard_error=0.0)
    return scaled(ratio, ratio.value**-2, "")


def _extreme(readings: Readings, sense: Sense) -> Metric:
    """The least reading for a lower bound, the largest for an upper one, without the noise that would choose it."""
    return debiased_minimum(readings) if sense == ">=" else debiased_maximum(readings)


def beam_angle(limit: LightLimit, light: Float[np.ndarray, " k"]) -> float:
    """Full angle (deg) between the outermost places of a cut at ``level`` of its maximum, linear between places."""
    assert limit.angles_deg is not None
    return width_above(limit.angles_deg, light, limit.level * float(light.max())) or 0.0
