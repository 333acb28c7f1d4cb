"""Outlines of the base seen along the axis, and the arcs on which the seat of a lens lies inside or outside them.

An outline (circle, circle with a clocking flat, square) is a closed chain of pieces, arcs of a circle about the axis
and straight lines, and gives the radius over azimuth. Crossings of seat and outline are found to 1e-14 rad.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from lensforge.spec import BaseSection

FULL_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Piece:
    """An arc of radius ``distance_mm`` about the axis, over the azimuths from ``start`` to ``end`` (rad).

    With ``normal`` (rad): a straight line at that distance from the axis, its normal at that azimuth.
    """

    start: float
    end: float
    distance_mm: float
    normal: float | None = None

    def radius(self, azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the axis at azimuths between the piece's ends."""
        if self.normal is None:
            return np.full_like(azimuths, self.distance_mm)
        return self.distance_mm / np.cos(azimuths - self.normal)


@dataclass(frozen=True)
class Outline:
    """Pieces in ascending azimuth, each beginning at the end of the one before."""

    pieces: tuple[Piece, ...]

    @property
    def corners(self) -> Float[np.ndarray, " k"]:
        """Azimuths (rad, within one turn) at which pieces meet; none for a circle."""
        return np.array([np.mod(piece.start, FULL_TURN) for piece in self.pieces] if len(self.pieces) > 1 else [])

    def radius(self, azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the axis, at azimuths of any turn."""
        turned = self._turned(azimuths)
        radius = np.empty_like(turned)
        for piece in self.pieces:
            within = (turned >= piece.start) & (turned <= piece.end)
            radius[within] = piece.radius(turned[within])
        return radius

    def piece_at(self, azimuth: float) -> Piece:
        """The piece at an azimuth."""
        turned = float(self._turned(np.array([azimuth]))[0])
        return next(piece for piece in self.pieces if piece.start <= turned <= piece.end)

    def _turned(self, azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Azimuths within the turn that begins with the first piece."""
        first = self.pieces[0].start
        last = self.pieces[-1].end
        return np.clip(first + np.mod(azimuths - first, FULL_TURN), first, last)


def circle(radius_mm: float) -> Outline:
    """A whole circle."""
    return Outline((Piece(0.0, FULL_TURN, radius_mm),))


def outline_of(base: BaseSection) -> Outline:
    """The outline of a base: a square has its sides across x and y, a clocking flat lies across +x."""
    if base.kind == "square":
        quarter = np.pi / 2.0
        starts = (np.arange(4) + 0.5) * quarter
        return Outline(tuple(Piece(s, s + quarter, base.side_mm / 2.0, s + quarter / 2.0) for s in starts.tolist()))
    radius = base.diameter_mm / 2.0
    if base.flat_mm is None:
        return circle(radius)
    half = float(np.arccos(base.flat_mm / radius))
    return Outline(
        (Piece(half, FULL_TURN - half, radius), Piece(FULL_TURN - half, FULL_TURN + half, base.flat_mm, FULL_TURN))
    )


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
    from scipy.optimize import brentq  # a fifth of a second, which a search does not need

    azimuths = sampled_azimuths()
    overhang = seat(azimuths) - outline.radius(azimuths)
    if np.abs(overhang).max() <= FLUSH_MM:
        return (Arc(0.0, FULL_TURN, "flush"),)
    outside = overhang > 0.0
    changes = np.nonzero(outside != np.roll(outside, -1))[0]
    if len(changes) == 0:
        return (Arc(0.0, FULL_TURN, "overhang" if outside[0] else "ledge"),)
    step = FULL_TURN / len(azimuths)

    def overhang_at(azimuth: float) -> float:
        at = np.array([azimuth])
        return float(seat(at)[0] - outline.radius(at)[0])

    starts = [float(brentq(overhang_at, azimuths[k], azimuths[k] + step, xtol=1e-14)) for k in changes]
    ends = [*starts[1:], starts[0] + FULL_TURN]
    relations: list[Relation] = ["ledge" if outside[k] else "overhang" for k in changes]
    return tuple(Arc(*arc) for arc in zip(starts, ends, relations, strict=True))


def sampled_azimuths() -> Float[np.ndarray, " n"]:
    """Azimuths (rad) over one turn at which rims are tested."""
    return np.linspace(0.0, FULL_TURN, _SAMPLES, endpoint=False)
