"""Arcs of the seat of a base: azimuths between which it stays inside or outside of the base's outline."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from lensforge.geometry.outline import FULL_TURN, Outline

Relation = Literal["bare", "ledge", "overhang", "flush"]
Radius = Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]]  # distance (mm) from the axis over azimuths

FLUSH_MM = 1e-6  # rim and outline closer than this all around are one edge
_SAMPLES = 2048  # azimuths: 20 across the narrowest usual SRBF


@dataclass(frozen=True)
class Arc:
    """Azimuths from ``start`` to ``end`` (rad) over which the seat keeps its ``relation`` to the outline."""

    start: float
    end: float
    relation: Relation


def arcs_between(seat: Radius, outline: Outline) -> tuple[Arc, ...]:
    """Arcs of ``seat`` against ``outline``, once around; a crossing is found to 1e-14 rad."""
    azimuths = sampled_azimuths()
    overhang = seat(azimuths) - outline.radius(azimuths)
    if np.abs(overhang).max() <= FLUSH_MM:
        return (Arc(0.0, FULL_TURN, "flush"),)
    outside = overhang > 0.0
    changes = np.nonzero(outside != np.roll(outside, -1))[0]
    if len(changes) == 0:
        return (Arc(0.0, FULL_TURN, "overhang" if outside[0] else "ledge"),)
    step = FULL_TURN / len(azimuths)
    starts = [_root(_overhang_at(seat, outline), azimuths[k], azimuths[k] + step) for k in changes]
    ends = [*starts[1:], starts[0] + FULL_TURN]
    relations: list[Relation] = ["ledge" if outside[k] else "overhang" for k in changes]
    return tuple(Arc(*arc) for arc in zip(starts, ends, relations, strict=True))


def _overhang_at(seat: Radius, outline: Outline) -> Callable[[float], float]:
    def overhang(azimuth: float) -> float:
        at = np.array([azimuth])
        return float(seat(at)[0] - outline.radius(at)[0])

    return overhang


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=1e-14))


def sampled_azimuths() -> Float[np.ndarray, " n"]:
    """Azimuths (rad) over one turn at which rims are tested."""
    return np.linspace(0.0, FULL_TURN, _SAMPLES, endpoint=False)
