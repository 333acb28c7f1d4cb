"""Light of rays that verification has drawn by itself, against the design's light: a test of the design's sampler.

All other casts take the design's rays: a sampler with a wrong distribution would mislead both sides alike. These rays
come from the description of the source; they are independent of each other, so that their noise is known.
"""

from dataclasses import dataclass

import numpy as np

from lensforge.records import Metric
from lensforge.sources.bundle import RayBundle
from lensforge.verification.comparison import Expected, flux_budget
from lensforge.verification.light_result import OwnRays
from lensforge.verification.own_rays_criteria import BLOCKS, LEAST_RAYS
from lensforge.verification.passage import LandedRays, Passage
from lensforge.verification.screen import squared_norm

_ROUNDING = 1e-9  # relative, of sums of products
RAYS = 2**14  # as many as the grid casts in the five seconds that this may take on two slow cores


@dataclass(frozen=True)
class DesignLight:
    """Light of the design on a receiver: its efficiency and the standard error, None if unknown; noise in its map."""

    efficiency: float
    standard_error: float | None
    nmse_of_noise: float | None


@dataclass(frozen=True)
class OwnLight:
    """Rays (of the same flux each) that verification has drawn, and the design's light on each receiver."""

    rays: RayBundle
    designs: tuple[DesignLight, ...]


def emission_apart(own: RayBundle, design: RayBundle) -> float:
    """Largest difference of a mean, or of a mean product of two, of start point and direction, in standard errors.

    Both samples as they leave the source, weighted by flux. The design's rays are quasi-random: they have no more noise
    than is counted here, that of independent rays.
    """
    rows, columns = np.triu_indices(7)
    means, squares = np.zeros(len(rows)), np.zeros(len(rows))
    for sign, rays in ((1.0, own), (-1.0, design)):
        table = np.column_stack([np.ones(len(rays)), rays.origins, rays.directions])
        products, weights = table[:, rows] * table[:, columns], rays.flux / rays.flux.sum()
        mean = weights @ products
        means += sign * mean
        squares += weights**2 @ (products - mean) ** 2
    scale = 1.0 + float(np.abs(own.origins).max())
    return float(np.max(np.abs(means) / (np.sqrt(squares) + _ROUNDING * scale**2)))


def judge_own_rays(rays: RayBundle, passage: Passage, expected: Expected, design: DesignLight) -> OwnRays:
    """Light of ``rays``, all of the same flux, on the screen of ``expected``, against its picture and ``design``."""
    landed, screen = LandedRays.of(passage, expected.screen), expected.screen
    flux, missed = flux_budget(rays, landed, screen)
    detected = np.where(screen.in_window(landed.landings), landed.flux, 0.0) / rays.flux.sum() * len(rays)
    error = float(np.std(detected, ddof=1)) / np.sqrt(len(rays)) if len(rays) > 1 else None
    return OwnRays(
        rays=len(rays),
        efficiency=Metric(value=flux.detected, standard_error=error),
        efficiency_design=Metric(value=design.efficiency, standard_error=design.standard_error),
        nmse_less_noise=_nmse_less_noise(landed, expected, design.nmse_of_noise),
        flux=flux,
        missed_by_cause=missed,
    )


def _nmse_less_noise(landed: LandedRays, expected: Expected, noise: float | None) -> Metric | None:
    """NMSE of the light behind the rays against the design's picture, whose own NMSE by noise is ``noise``.

    The mean product of the errors of two different blocks of rays has no noise of these rays (Hoeffding 1948); its
    standard error is by the jackknife over the blocks, up to 1.4 times too large (Efron & Stein 1981).
    """
    if noise is None or len(landed.flux) < LEAST_RAYS:
        return None
    screen, count = expected.screen, len(landed.flux)
    pictures = (
        screen.irradiance(landed.landings[rows], landed.flux[rows] * (count / len(rows)))
        for rows in np.array_split(np.arange(count), BLOCKS)
    )
    errors = np.stack([picture - expected.irradiance for picture in pictures]).reshape(BLOCKS, -1)
    products = errors @ errors.T / squared_norm(expected.irradiance)
    np.fill_diagonal(products, 0.0)
    total = float(products.sum())
    without = (total - 2.0 * products.sum(axis=1)) / ((BLOCKS - 1) * (BLOCKS - 2))
    error = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((without - without.mean()) ** 2))
    return Metric(value=total / (BLOCKS * (BLOCKS - 1)) - noise, standard_error=float(error))
