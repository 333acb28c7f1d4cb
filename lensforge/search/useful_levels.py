"""Levels of functions that may help a search: finer ones do until the source, the receiver or the cutter blurs them."""

from dataclasses import dataclass

import numpy as np

from lensforge.sources.ray_bundle import Source
from lensforge.spec import AnyReceiver, Spec
from lensforge.spec.receiver_sections import CylinderReceiver, FarFieldReceiver, PlaneReceiver, SphereReceiver
from lensforge.surfaces.srbf import level_sigma

_CANDIDATES = (9, 25, 81, 289, 1089, 4225)  # about four times as many functions, of half the width, each time
# Least width of a function, sigma, relative to the angle under which the outer face sees the source. One 1 mm wide in
# a lens of 2.45 mm gains from 289 functions (0.36 of it) and loses by 1,089 (0.18). What lies above may still gain too
# little: the search finds out.
_OF_SOURCE = 0.2


@dataclass(frozen=True)
class UsefulLevels:
    """Numbers of functions of the levels that may be tried, and ``why`` there are no finer ones."""

    counts: tuple[int, ...]
    why: str

    @staticmethod
    def of(spec: Spec, source: Source, finest: int) -> "UsefulLevels":
        """Levels for ``spec`` up to ``finest`` functions; at least the first."""
        narrowest_rad, reason = max(_limits(spec, source))
        counts = [_CANDIDATES[0]]
        for count in _CANDIDATES[1:]:
            if count > finest:
                return UsefulLevels(tuple(counts), f"finest level of this accuracy: {counts[-1]} functions")
            if level_sigma(count, spec.lens.sigma_c) < narrowest_rad:
                words = f"functions narrower than {narrowest_rad:.2g} rad would not show: {reason}"
                return UsefulLevels(tuple(counts), words)
            counts.append(count)
        return UsefulLevels(tuple(counts), f"finest level there is: {counts[-1]} functions")

    def resolving(self, detail_rad: float, sigma_c: float) -> int:
        """The coarsest level whose functions are as narrow as ``detail_rad``, or the last."""
        narrow = [level_sigma(count, sigma_c) <= 1.001 * detail_rad for count in self.counts]
        return narrow.index(True) if any(narrow) else len(narrow) - 1


def _limits(spec: Spec, source: Source) -> list[tuple[float, str]]:
    """Widths (rad) below which a function is useless, each with its reason."""
    radius_mm, found = spec.constraints.max_radius_mm, []
    outline = source.outline()
    width_mm = float(np.ptp(outline[:, :2], axis=0).max()) if len(outline) else 0.0
    found.append((_OF_SOURCE * width_mm / radius_mm, f"a fifth of the angle of the source, {width_mm:.3g} mm wide"))
    pixel_rad = min(_pixel_rad(receiver, spec.evaluate.pixels) for receiver in spec.all_receivers)
    for face in ("inner", "outer"):
        limit_mm = getattr(spec.constraints, f"{face}_concave_radius_mm")
        ball_mm = spec.manufacture.cutter_radius_mm if limit_mm is None else limit_mm
        words = f"what a ball of {ball_mm:g} mm reaches in the {face} face moves the light by less than a pixel"
        found.append((_width_of_ball(spec, ball_mm, pixel_rad), words))
    return found


def _pixel_rad(receiver: AnyReceiver, pixels: int) -> float:
    """Angle of a pixel as seen from the lens, where the receiver is nearest."""
    pixel = max(receiver.size) / pixels
    match receiver:
        case FarFieldReceiver():
            return pixel
        case PlaneReceiver():
            return pixel / receiver.distance_mm
        case CylinderReceiver() | SphereReceiver():
            return pixel / receiver.radius_mm


def _width_of_ball(spec: Spec, ball_mm: float, pixel_rad: float) -> float:
    """Width (rad) of a function that, hollow as a ball of that radius, moves the light by one pixel.

    Its slope is width over twice the ball's radius, and light turns by ``n - 1`` times that in air.
    """
    turn = spec.lens.media.largest_turning_power
    return 2.0 * ball_mm * pixel_rad / (turn * spec.constraints.max_radius_mm) if turn > 0.0 else 0.0
