"""Backlight, uplight and glare of a lamp (BUG rating) by the lumens of its zones.

Zones: ANSI/IES TM-15-11, luminaire classification system; ratings: its addendum A. A lamp shines forward, towards the
street, and back; low, mid, high and very high by gamma. A rating is that of its worst zone.
"""

from collections.abc import Mapping

from lensforge.records import Count, Flag, Metric, Record
from lensforge.roadway.lamp_light import LampLight

_FORWARD, _BACK = (-90.0, 90.0), (90.0, 270.0)
_GAMMA = {"low": (0.0, 30.0), "mid": (30.0, 60.0), "high": (60.0, 80.0), "very_high": (80.0, 90.0)}
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
    def of(lamp: LampLight) -> "ZoneLumens":
        """Integrate the light of ``lamp``; a lens sends none above 90 degrees."""
        sides = {"forward": _FORWARD, "back": _BACK}
        found = {
            f"{side}_{height}": lamp.flux(lateral, gamma)
            for side, lateral in sides.items()
            for height, gamma in _GAMMA.items()
        }
        none = Metric(value=0.0, unit="lm", standard_error=0.0)
        return ZoneLumens(**found, up_low=none, up_high=none)


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
    def of(zones: ZoneLumens, *, symmetric: bool) -> "BugRating":
        """Rate ``zones``; ``symmetric``: of distribution type V, whose back light has the bounds of forward light."""
        glare = {**_GLARE, "back_high": _BACK_HIGH_GLARE[symmetric]}
        low, high = (
            tuple(_rating(zones, table, side * _DOUBT) for table in (_BACKLIGHT, _UPLIGHT, glare)) for side in (-1, 1)
        )
        backlight, uplight, worst = (_rating(zones, table) for table in (_BACKLIGHT, _UPLIGHT, glare))
        return BugRating(backlight=backlight, uplight=uplight, glare=worst, certain=low == high, zones=zones)


def _rating(zones: ZoneLumens, table: Mapping[str, tuple[float, ...]], errors: float = 0.0) -> int:
    """Rating of the worst zone in ``table``, its lumens moved by so many standard ``errors``."""
    worst = 0
    for name, most in table.items():
        found: Metric = getattr(zones, name)
        lumens = found.value + errors * (found.standard_error or 0.0)
        worst = max(worst, sum(lumens > each for each in most))
    return worst
