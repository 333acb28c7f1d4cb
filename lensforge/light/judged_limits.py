"""Limits on the light, judged: the value that decides each, without ray noise, with its standard error."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from lensforge.light.evaluation_result import LimitResult
from lensforge.light.least_irradiance import largest_without_noise, least_over_mean, least_without_noise, ratio_of
from lensforge.light.metrics import jackknife_metric
from lensforge.results import Metric, Sense
from lensforge.scene.limit_readings import LightLimit
from lensforge.sources.intensity import width_above

Images = Float[np.ndarray, "_ _ _"]  # of each replicate; each receiver has a shape of its own
Readings = Float[np.ndarray, "r k"]


def judged_limits(
    limits: Sequence[LightLimit], images: Sequence[Images], names: Sequence[str]
) -> tuple[LimitResult, ...]:
    """Judge ``limits`` on the filtered pictures of flux (W) of every replicate, one stack for each receiver."""
    return tuple(_judged(limit, images[limit.receiver], names[limit.receiver]) for limit in limits)


def _judged(limit: LightLimit, images: Float[np.ndarray, "r h w"], receiver: str) -> LimitResult:
    return LimitResult(
        name=limit.name,
        receiver=receiver,
        quantity=_WORDS[limit.quantity],
        value=limit_value(limit, images),
        sense=limit.sense,
        bound=limit.bound,
        unit=limit.unit,
    )


_WORDS = {
    "light": "light",
    "relative": "light over its maximum",
    "min_over_mean": "least over mean light",
    "min_over_max": "least over largest light",
    "share": "share of the flux",
    "beam_angle": "beam angle",
}


def limit_value(limit: LightLimit, images: Float[np.ndarray, "r h w"]) -> Metric:
    """The value that decides, in the limit's unit."""
    readings = limit.of(images)
    match limit.quantity:
        case "share":
            return jackknife_metric(readings.sum(axis=1), float)
        case "beam_angle":
            return jackknife_metric(readings, lambda mean: beam_angle(limit, mean), limit.unit)
        case "light":
            return _extreme(readings, limit.sense).model_copy(update={"unit": limit.unit})
        case "min_over_mean":
            return least_over_mean(readings).metric()
    whole = readings if limit.quantity == "min_over_max" else limit.light_per_flux * images.reshape(len(images), -1)
    return ratio_of(_extreme(readings, limit.sense if limit.quantity == "relative" else ">="), _extreme(whole, "<="))


def _extreme(readings: Readings, sense: Sense) -> Metric:
    """The least reading for a lower bound, the largest for an upper one, without the noise that would choose it."""
    return least_without_noise(readings) if sense == ">=" else largest_without_noise(readings)


def beam_angle(limit: LightLimit, light: Float[np.ndarray, " k"]) -> float:
    """Full angle (deg) between the outermost places of a cut at ``level`` of its maximum, linear between places."""
    assert limit.angles_deg is not None
    return width_above(limit.angles_deg, light, limit.level * float(light.max())) or 0.0
