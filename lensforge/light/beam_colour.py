"""Colour of a beam: its mean in u', v' and as a temperature, and how far colours in it are from that mean.

The beam is where the filtered light is above a level of its peak. Its mean colour is that of all its light mixed.
With U = 4 X - u0 D, V = 9 Y - v0 D and D = X + 15 Y + 3 Z, a pixel's distance from the colour (u0, v0) is
|(U, V)| / D. U and V are linear in the light, so that products of two replicates have no noise. D is that of all rays
together: its noise enters as a factor 1 + 1/n of n rays in a pixel.

The largest distance is that along the best of 32 directions in u', v', which is at most 0.5 % too small: distances
along a direction are linear, and their largest is known without the noise that chooses it. No largest is below the rms.
"""

from typing import Annotated

import numpy as np
from jaxtyping import Float

from lensforge.optics.colorimetry import ColourTemperature, away_from, colour_temperature, denominator, uv_of
from lensforge.results import Count, Metric, Record, Share
from lensforge.results.estimates import debiased_maximum, jackknife_metric, root_estimate
from lensforge.results.figure import Figure
from lensforge.results.numerals import percent

Pictures = Float[np.ndarray, "3 r h w"]  # X, Y, Z (lm) in each pixel, by every replicate
Light = Float[np.ndarray, "r n 3"]  # X, Y, Z (lm) of pixels, by every replicate
_DIRECTIONS = 32
_FEW_PIXELS = 2**6  # of a part, of which there are thousands, each judged seventeen times
_MOST_PIXELS = 2**13  # of which the worst is sought: those that look worst, where there are more


class BeamColour(Record):
    """Colour of the light on a receiver where it is above ``level`` of its peak, on so many ``pixels``.

    ``u``, ``v``: u', v' (CIE 1976) of the light there, mixed. ``cct`` (K), ``duv``: correlated colour temperature and
    distance from Planck's locus; None for light without one. ``rms``, ``worst``: root mean square and largest of the
    distances in u', v' of its pixels from that colour.
    """

    level: Share
    pixels: Count
    u: Annotated[Metric, Figure("Colour u′", "mean {beam_words}", key="colour_u")]
    v: Annotated[Metric, Figure("Colour v′", key="colour_v")]
    cct: Annotated[Metric | None, Figure("Colour temperature", "{temperature_words}", key="cct", missing="none")]
    duv: Annotated[Metric | None, Figure("Duv", "distance from Planck’s locus, positive towards green", key="duv")]
    rms: Annotated[Metric, Figure("Δu′v′ rms", "from that colour, {beam_words}", key="rms_delta_uv")]
    worst: Annotated[Metric, Figure("Δu′v′ worst", "of a pixel there", key="worst_delta_uv")]

    @property
    def beam_words(self) -> str:
        """Phrase that defines the beam."""
        return f"where the light is above {percent(self.level)} of its peak"

    @property
    def temperature_words(self) -> str:
        """Definition of the temperature, or the reason why it has none."""
        return "Duv above 0.05" if self.cct is None else "correlated (Ohno 2013)"

    @staticmethod
    def of(pictures: Pictures, level: float) -> "BeamColour | None":
        """Colour of filtered ``pictures``; None if one of the replicates is dark."""
        light = _in_beam(pictures, level)
        if light is None:
            return None
        totals = light.sum(axis=1)
        away = _away(light)
        mean = uv_of(totals.mean(axis=0))
        temperature = colour_temperature(mean)
        rms = _rms(away)
        return BeamColour(
            level=level,
            pixels=light.shape[1],
            u=jackknife_metric(totals, lambda mean: float(uv_of(mean)[0])),
            v=jackknife_metric(totals, lambda mean: float(uv_of(mean)[1])),
            cct=None if temperature is None else _of_temperature(totals, temperature, 0, "K"),
            duv=None if temperature is None else _of_temperature(totals, temperature, 1, ""),
            rms=rms,
            worst=_worst(away, rms),
        )


def distances_left_out(pictures: Pictures, level: float) -> list[dict[str, Metric] | None]:
    """``rms`` and ``worst`` of filtered ``pictures`` by all replicates, then with each left out in turn.

    None in the dark. The pixels of the beam are those of all replicates; the worst is sought among fewer of them.
    """
    light = _in_beam(pictures, level)
    rows = np.arange(pictures.shape[1])
    replicate_sets = [rows, *(rows[rows != k] for k in rows if len(rows) > 1)]
    if light is None:
        return [None] * len(replicate_sets)
    away = [_away(light[replicates]) for replicates in replicate_sets]
    return [{"rms": (rms := _rms(distances)), "worst": _worst(distances, rms, _FEW_PIXELS)} for distances in away]


def _in_beam(pictures: Pictures, level: float) -> Light | None:
    """Light of the pixels above ``level`` of the peak; None if one of the replicates is dark there."""
    luminous = pictures[1]
    replicates = pictures.shape[1]
    if not (luminous.sum(axis=(1, 2)) > 0.0).all():
        return None
    peak = debiased_maximum(luminous.reshape(replicates, -1)).value
    light: Light = np.moveaxis(pictures[:, :, luminous.mean(axis=0) >= level * peak], 0, -1)
    return light if (light[..., 1].sum(axis=1) > 0.0).all() else None


def _away(light: Light) -> Float[np.ndarray, "r n 2"]:
    """Distances in u', v' of pixels from the colour of all their light mixed."""
    mean = uv_of(light.sum(axis=1).mean(axis=0))
    return away_from(mean, light) / denominator(light.mean(axis=0))[:, None]


def _of_temperature(totals: Float[np.ndarray, "r 3"], known: ColourTemperature, index: int, unit: str) -> Metric:
    """Colour temperature or duv with its error; ``known`` counts if only some of the replicates have one."""
    return jackknife_metric(totals, lambda mean: float((colour_temperature(uv_of(mean)) or known)[index]), unit)


def _rms(away: Float[np.ndarray, "r n 2"]) -> Metric:
    """Root mean square of the distances of ``n`` pixels, corrected for the bias of noise."""
    return root_estimate(away.reshape(len(away), -1) / np.sqrt(away.shape[1]), np.ones(len(away))).metric()


def _worst(away: Float[np.ndarray, "r n 2"], rms: Metric, pixels: int = _MOST_PIXELS) -> Metric:
    """Largest distance of ``n`` pixels without noise bias, at least ``rms``; among the ``pixels`` that look worst."""
    seen = np.linalg.norm(away.mean(axis=0), axis=1)
    if len(seen) > pixels:
        away = away[:, np.argpartition(seen, -pixels)[-pixels:]]
    angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    along = away @ np.stack([np.cos(angles), np.sin(angles)])
    return debiased_maximum(along.reshape(len(away), -1), least=rms.value)
