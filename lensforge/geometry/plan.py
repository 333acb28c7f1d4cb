"""The plan of the body in z = 0: where the inner rim, the outer rim and the base's cylinder lie.

All three are radii over the azimuth. The outer rim may lie inside the cylinder (a *ledge* of the base shows
above), outside (the dome *overhangs* the base), on it (*flush*), or change over where it *crosses* the
cylinder. Mesh and solid are both built arc by arc from this plan, so neither needs a boolean operation.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from lensforge.errors import InputError
from lensforge.geometry.patch import Patch
from lensforge.spec import BaseSection
from lensforge.surfaces.chart import grid, to_sphere

Relation = Literal["bare", "ledge", "overhang", "flush"]

FULL_TURN = 2.0 * np.pi
FLUSH_MM = 1e-6  # rim and cylinder closer than this all around are one edge
_MIN_BASE_WALL_MM = 0.01
_SAMPLES = 2048  # azimuths: 20 for each width of the narrowest usual SRBF
_WALL_NODES = 96  # chart nodes where the wall is looked at


@dataclass(frozen=True)
class Arc:
    """Azimuths from ``start`` to ``end`` (rad) over which the outer rim keeps its ``relation`` to the cylinder."""

    start: float
    end: float
    relation: Relation


@dataclass(frozen=True)
class Plan:
    """The two optical faces of a lens, its base, and the arcs of the outer rim, which go once around."""

    inner: Patch
    outer: Patch
    base: BaseSection
    arcs: tuple[Arc, ...]

    @property
    def has_base(self) -> bool:
        """Whether there is a cylinder below z = 0."""
        return self.base.kind == "cylinder"

    @property
    def base_radius_mm(self) -> float:
        """Radius of the base's cylinder."""
        return self.base.diameter_mm / 2.0

    @property
    def crossings(self) -> Float[np.ndarray, " k"]:
        """Azimuths (rad) at which the outer rim crosses the cylinder; none or an even number."""
        return np.array([arc.start for arc in self.arcs] if len(self.arcs) > 1 else [])


def rim_directions(azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Unit directions in the plane z = 0, which is exact in the last column."""
    return np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros_like(azimuths)], axis=-1)


def make_plan(inner: Patch, outer: Patch, base: BaseSection) -> Plan:
    """Lay out the body. Raises :class:`InputError` if the surfaces touch or the base cannot hold the cavity."""
    _require_wall(inner, outer)
    if base.kind == "none":
        return Plan(inner, outer, base, (Arc(0.0, FULL_TURN, "bare"),))
    radius = base.diameter_mm / 2.0
    _require_opening_inside(inner, radius)
    return Plan(inner, outer, base, _arcs(outer, radius))


def _require_wall(inner: Patch, outer: Patch) -> None:
    chart = grid(_WALL_NODES, half_width=1.0).reshape(-1, 2)
    directions = to_sphere(chart[np.sum(chart**2, axis=1) <= 1.0])
    directions = np.concatenate([directions, rim_directions(_samples())])
    wall = outer.radius(directions) - inner.radius(directions)
    worst = int(np.argmin(wall))
    if wall[worst] <= 0.0:
        x, y, z = directions[worst]
        raise InputError(
            f"wall = {wall[worst]:.4g} mm in the direction ({x:.3f}, {y:.3f}, {z:.3f}): the outer surface must lie "
            "outside the inner one; raise constraints.min_thickness_mm and design again"
        )


def _require_opening_inside(inner: Patch, radius: float) -> None:
    opening = float(inner.radius(rim_directions(_samples())).max())
    if opening + _MIN_BASE_WALL_MM > radius:
        raise InputError(
            f"base.diameter_mm = {2.0 * radius:g}: the cavity opens to {2.0 * opening:.4g} mm and must fit inside; "
            f"at least {2.0 * (opening + _MIN_BASE_WALL_MM):.4g}, or base.kind = 'none'"
        )


def _arcs(outer: Patch, radius: float) -> tuple[Arc, ...]:
    azimuths = _samples()
    height = outer.radius(rim_directions(azimuths)) - radius
    if np.abs(height).max() <= FLUSH_MM:
        return (Arc(0.0, FULL_TURN, "flush"),)
    outside = height > 0.0
    changes = np.nonzero(outside != np.roll(outside, -1))[0]
    if len(changes) == 0:
        return (Arc(0.0, FULL_TURN, "overhang" if outside[0] else "ledge"),)
    step = FULL_TURN / len(azimuths)
    starts = [_root(_rim_above(outer, radius), azimuths[k], azimuths[k] + step) for k in changes]
    ends = [*starts[1:], starts[0] + FULL_TURN]
    relations: list[Relation] = ["ledge" if outside[k] else "overhang" for k in changes]
    return tuple(Arc(*arc) for arc in zip(starts, ends, relations, strict=True))


def _rim_above(outer: Patch, radius: float) -> Callable[[float], float]:
    return lambda azimuth: float(outer.radius(rim_directions(np.array([azimuth])))[0] - radius)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=1e-14))


def _samples() -> Float[np.ndarray, " n"]:
    return np.linspace(0.0, FULL_TURN, _SAMPLES, endpoint=False)
