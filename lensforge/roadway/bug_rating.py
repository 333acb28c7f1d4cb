"""Backlight, uplight and glare of a lamp (BUG rating) by the lumens of its zones.

Zones: ANSI/IES TM-15-11, luminaire classification system; ratings: its addendum A. A lamp shines forward, towards the
street, and back; low, mid, high and very high by gamma. A rating is that of its worst zone. Zones are sums over rays: a
table of intensity is a step of its angles wide at an edge of the light.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from lensforge.jackknife import jackknife_metric
from lensforge.records import Count, Flag, Metric, Record
from lensforge.sources.bundle import RayBundle
from lensforge.surfaces.symmetry import group

_SIDES, _HEIGHTS = ("forward", "back"), ("low", "mid", "high", "very_high")
_GAMMA_DEG = (30.0, 60.0, 80.0)  # between these heights
# Most lumens of a zone for the ratings 0 to 4; more is rated 5.
_BACKLIGHT = {
    "back_high": (110.0, 500.0, 1000.0, 2500.0, 5000.0),
    "back_mid": (220.0, 1000.0, 2500.0, 5000.0, 8500.0),
    "back_low": (110.0, 500.0, 1000.0, 2500.0, 5000.0),
}
_UPLIGHT = dict.fromkeys(("up_high", "up_low"), (0.0, 10.0, 50.0, 500.0, 1000.0))
_GLARE = {
    "forward_very_high": (10.0, 100.0, 225.0, 500.0, 750.0),
    "back_very_high": (10.0, 100.0, 225.0, 500.0, 750.0),
    "forward_high": (660.0, 1800.0, 5000.0, 7500.0, 12000.0),
}
_BACK_HIGH_GLARE = {False: (110.0, 500.0, 1000.0, 2500.0, 5000.0), True: (660.0, 1800.0, 5000.0, 7500.0, 12000.0)}
_DOUBT = 2.0  # standard errors within which a rating may be the next


class ZoneLumens(Record):
    """Lumens by zone: forward and back at gamma to 30, 60, 80 and 90 degrees, and up to 100 and 180 degrees."""

    forward_low: Metric
    forward_mid: Metric
    forward_high: Metric
    forward_very_high: Metric
    back_low: Metric
    back_mid: Metric
    back_high: Metric
    back_very_high: Metric
    up_low: Metric
    up_high: Metric

    @staticmethod
    def of(samples: Float[np.ndarray, "p 2 4"]) -> "ZoneLumens":
        """The mean of independent ``samples`` of :func:`zone_flux` (lm); a lens sends none above 90 degrees."""
        found = {
            f"{side}_{height}": jackknife_metric(samples[:, row, column], float, "lm")
            for row, side in enumerate(_SIDES)
            for column, height in enumerate(_HEIGHTS)
        }
        none = Metric(value=0.0, unit="lm", standard_error=0.0)
        return ZoneLumens(**found, up_low=none, up_high=none)


def zone_flux(rays: RayBundle, street_deg: float, symmetry: str) -> Float[np.ndarray, "2 4"]:
    """Flux of ``rays``, which go upwards, forward and back (rows) and by height; mean over their mirror images.

    ``street_deg``: azimuth of the street.
    """
    height = np.digitize(-rays.directions[:, 2], -np.cos(np.deg2rad(_GAMMA_DEG)))
    street, total = np.array([np.cos(np.deg2rad(street_deg)), np.sin(np.deg2rad(street_deg))]), np.zeros(8)
    for image in group(symmetry):
        back = rays.directions[:, :2] @ image[:2, :2].T @ street <= 0.0
        total += np.bincount(height + len(_HEIGHTS) * back, rays.flux, minlength=8)
    return total.reshape(2, 4) / len(group(symmetry))


class BugRating(Record):
    """Ratings from 0 to 5, and the lumens of the ``zones``. ``certain``: none would change by two standard errors."""

    backlight: Count
    uplight: Count
    glare: Count
    certain: Flag
    zones: ZoneLumens

    def __str__(self) -> str:
        return f"B{self.backlight} U{self.uplight} G{self.glare}" + ("" if self.certain else " (uncertain)")

    @staticmethod
    def of(zones: ZoneLumens, *, symmetric: bool, doubtful: bool = False) -> "BugRating":
        """Rate ``zones``; ``symmetric``: of distribution type V, whose back light has the bounds of forward light.

        ``doubtful``: whether it may be the other way round.
        """

        def rated(errors: float, even: bool) -> tuple[int, ...]:
            glare = {**_GLARE, "back_high": _BACK_HIGH_GLARE[even]}
            return tuple(_rating(zones, table, errors) for table in (_BACKLIGHT, _UPLIGHT, glare))

        backlight, uplight, glare = rated(0.0, symmetric)
        evens = {symmetric, symmetric ^ doubtful}
        certain = len({rated(errors, even) for errors in (-_DOUBT, _DOUBT) for even in evens}) == 1
        return BugRating(backlight=backlight, uplight=uplight, glare=glare, certain=certain, zones=zones)


def _rating(zones: ZoneLumens, table: Mapping[str, tuple[float, ...]], errors: float = 0.0) -> int:
    """Rating of the worst zone in ``table``, its lumens moved by so many standard ``errors``."""
    worst = 0
    for name, most in table.items():
        found: Metric = getattr(zones, name)
        lumens = found.value + errors * (found.standard_error or 0.0)
        worst = max(worst, sum(lumens > each for each in most))
    return worst
