"""Radiance R(x, y, C, gamma) in the plane z = 0 as a table, and its flux in closed form.

A surface element emits ``R cos(gamma) dA dOmega``, and ``cos(gamma) dOmega = dC d(sin^2 gamma) / 2``. So the table is
taken as constant in each cell of (x, y) and bilinear in (C, sin^2 gamma): every flux is then a trapezoid, its inverse
the root of a quadratic, and nothing is approximated but the radiance between the table's nodes.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from lensforge.sources.areas import largest_symmetry

_M2_PER_MM2 = 1e-6
_SAME = 1e-6  # of the largest radiance, and of the width: what differs less is symmetric


@dataclass(frozen=True, eq=False)
class RadianceTable:
    """``radiance`` (W/m^2/sr) by cell of the edges ``y_mm`` and ``x_mm``, azimuth ``c_deg``, polar angle ``gamma_deg``.

    ``c_deg`` runs from 0 to 360, both included, or is the single number 0 for light of revolution about each point's
    own normal. There is no light beyond the first and last gamma.
    """

    x_mm: Float[np.ndarray, " x1"]
    y_mm: Float[np.ndarray, " y1"]
    c_deg: Float[np.ndarray, " c"]
    gamma_deg: Float[np.ndarray, " g"]
    radiance: Float[np.ndarray, "y x c g"]

    @cached_property
    def squares(self) -> Float[np.ndarray, " g"]:
        """``sin^2 gamma`` at the nodes, never falling."""
        squares: Float[np.ndarray, " g"] = np.sin(np.deg2rad(self.gamma_deg)) ** 2
        return squares

    @cached_property
    def cumulative(self) -> Float[np.ndarray, "y x c g"]:
        """``R cos sin`` integrated up to each gamma: W/m^2 per radian of azimuth."""
        cells = 0.25 * (self.radiance[..., 1:] + self.radiance[..., :-1]) * np.diff(self.squares)
        start = np.zeros((*self.radiance.shape[:3], 1))
        return np.concatenate([start, np.cumsum(cells, axis=3)], axis=3)

    @cached_property
    def sectors(self) -> Float[np.ndarray, "y x s"]:
        """Radiant exitance (W/m^2) of each cell into each sector of azimuth."""
        planes = self.cumulative[..., -1]
        if len(self.c_deg) == 1:
            return 2.0 * np.pi * planes
        exitance: Float[np.ndarray, "y x s"] = (
            0.5 * (planes[..., 1:] + planes[..., :-1]) * np.diff(np.deg2rad(self.c_deg))
        )
        return exitance

    @cached_property
    def cell_fluxes(self) -> Float[np.ndarray, "y x"]:
        """Flux (W) of each cell."""
        areas = np.diff(self.y_mm)[:, None] * np.diff(self.x_mm) * _M2_PER_MM2
        fluxes: Float[np.ndarray, "y x"] = self.sectors.sum(axis=2) * areas
        return fluxes

    def flux(self) -> float:
        """The integral over area and projected solid angle (W), exact for the interpolation."""
        return float(self.cell_fluxes.sum())

    @property
    def symmetry(self) -> str:
        """Found by comparing the table with its mirror images."""
        return largest_symmetry(self._unchanged)

    def _unchanged(self, mirror: Float[np.ndarray, "3 3"]) -> bool:
        """Whether the mirror image has the same edges, and the same radiance in each cell and direction."""
        swapped, signs = mirror[0, 0] == 0.0, mirror[:2, :2].sum(axis=1).astype(int)
        edges = (self.y_mm, self.x_mm) if swapped else (self.x_mm, self.y_mm)
        width = float(np.ptp(self.x_mm) + np.ptp(self.y_mm))
        for own, image, sign in zip((self.x_mm, self.y_mm), edges, signs, strict=True):
            if len(own) != len(image) or np.abs(own - sign * image[::sign]).max() > _SAME * width:
                return False
        by_x = np.swapaxes(self._turned(mirror), 0, 1)
        by_x = (np.swapaxes(by_x, 0, 1) if swapped else by_x)[:: signs[0], :: signs[1]]
        return bool(np.abs(np.swapaxes(by_x, 0, 1) - self.radiance).max() <= _SAME * self.radiance.max())

    def _turned(self, mirror: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "y x c g"]:
        """The radiance into the directions whose mirror images are the nodes."""
        if len(self.c_deg) == 1:
            return self.radiance
        angle = np.deg2rad(self.c_deg)
        before = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ mirror[:2, :2]
        degrees = np.rad2deg(np.arctan2(before[:, 1], before[:, 0])) % 360.0
        place = np.interp(degrees, self.c_deg, np.arange(len(self.c_deg)))
        low = np.minimum(place.astype(int), len(self.c_deg) - 2)
        turned: Float[np.ndarray, "y x c g"] = self.radiance[:, :, low] + (place - low)[:, None] * (
            self.radiance[:, :, low + 1] - self.radiance[:, :, low]
        )
        return turned
