"""Intensities of a far field over C and gamma, as photometric files hold them, and the flux in them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class CandelaTable:
    """Intensity at ``gamma_deg`` in half-planes ``c_deg``, bilinear in between, none beyond the first and last gamma.

    ``c_deg`` runs from 0 to 360, both included, or is the single number 0 for a distribution of revolution.
    """

    c_deg: Float[np.ndarray, " c"]
    gamma_deg: Float[np.ndarray, " g"]
    values: Float[np.ndarray, "c g"]

    @cached_property
    def plane_fluxes(self) -> Float[np.ndarray, " c"]:
        """Integral of ``I sin(gamma) dgamma`` in each half-plane (W/rad or lm/rad)."""
        return flux_up_to(np.deg2rad(self.gamma_deg), self.values)[:, -1]

    def flux(self) -> float:
        """Integral over all directions, exact for the bilinear interpolation."""
        if len(self.c_deg) == 1:
            return float(2.0 * np.pi * self.plane_fluxes.item())
        return float(np.trapezoid(self.plane_fluxes, np.deg2rad(self.c_deg)))

    def share_up_to(self, gamma_deg: float) -> float:
        """Share of the flux at gamma up to ``gamma_deg``, exact for the bilinear interpolation."""
        below = self.gamma_deg < gamma_deg
        if below.all() or not below.any():
            return float(below.all())
        at_end = np.array([[np.interp(gamma_deg, self.gamma_deg, plane)] for plane in self.values])
        values = np.concatenate([self.values[:, below], at_end], axis=1)
        part = CandelaTable(self.c_deg, np.append(self.gamma_deg[below], gamma_deg), values)
        return min(part.flux() / self.flux(), 1.0)

    def pole_mean(self, gamma_deg: float) -> float:
        """Mean intensity over the half-planes at the first or last gamma, counting each half-plane once."""
        column = 0 if gamma_deg == self.gamma_deg[0] else -1
        return float(self.values[: max(len(self.c_deg) - 1, 1), column].mean())

    def at(self, c_deg: float) -> Float[np.ndarray, " g"]:
        """Interpolated half-plane at ``c_deg``, any angle."""
        if len(self.c_deg) == 1:
            return np.asarray(self.values[0])
        place = np.interp(c_deg % 360.0, self.c_deg, np.arange(len(self.c_deg)))
        low = min(int(place), len(self.c_deg) - 2)
        return np.asarray(self.values[low] + (place - low) * (self.values[low + 1] - self.values[low]))


def flux_up_to(gamma: Float[np.ndarray, " g"], values: Float[np.ndarray, "c g"]) -> Float[np.ndarray, "c g"]:
    """Integrate the flux per radian of azimuth up to each gamma (rad), exact for an intensity linear in gamma."""
    low = gamma[:-1]
    high = gamma[1:]
    cos_low = np.cos(low)
    cos_high = np.cos(high)
    slope = np.diff(values, axis=1) / (high - low)
    # Integral of (a + b (gamma - low)) sin(gamma), with differences of sines and cosines kept apart.
    cells = values[:, :-1] * cos_low - values[:, 1:] * cos_high + slope * (np.sin(high) - np.sin(low))
    return np.concatenate([np.zeros((len(values), 1)), np.cumsum(np.maximum(cells, 0.0), axis=1)], axis=1)
