"""Outlines of the base seen along the axis (circle, circle with a clocking flat, square) as radius over azimuth.

An outline is a closed chain of pieces: arcs of a circle about the axis, and straight lines.
"""

from dataclasses import dataclass

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
        """Azimuths (rad, within one turn) where two pieces meet; none for a plain circle."""
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
        """The same azimuths within the turn that begins with the first piece."""
        first, last = self.pieces[0].start, self.pieces[-1].end
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
        (
            Piece(half, FULL_TURN - half, radius),
            Piece(FULL_TURN - half, FULL_TURN + half, base.flat_mm, FULL_TURN),
        )
    )
