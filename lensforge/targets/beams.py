"""Relative intensity of each target of the far field, at angles along x and y (degrees) that broadcast."""

import numpy as np
from jaxtyping import Float
from scipy.special import erfc

from lensforge.sources.intensity import TabulatedIntensity
from lensforge.spec.beams import BatwingTarget, BeamTarget

_HORIZON = 89.0  # degrees: no plane is lit beyond

Degrees = Float[np.ndarray, "..."]


def beam(target: BeamTarget, x: Degrees, y: Degrees) -> Degrees:
    """A beam: its full widths at half maximum are those of the target, along x and along y."""
    width, height = target.sides("fwhm")
    ellipse = (2.0 * x / width) ** 2 + (2.0 * y / height) ** 2
    if target.profile == "gaussian":
        return np.asarray(np.exp2(-ellipse))
    if target.profile == "flat":
        return np.asarray(ellipse <= 1.0, dtype=np.float64)
    gamma = np.hypot(x, y)
    # half the width in the direction of each place; on the axis, where no direction is, the power does not count
    half = np.divide(gamma, np.sqrt(ellipse), out=np.ones_like(gamma), where=gamma > 0.0)
    power = np.log(0.5) / np.log(np.cos(np.radians(half)))
    return np.asarray(np.where(gamma < 90.0, np.cos(np.radians(gamma)), 0.0) ** power)


def batwing(target: BatwingTarget, x: Degrees, y: Degrees) -> Degrees:
    """Even illuminance on a plane, which falls at its edge as the integral of a Gaussian."""
    gamma, to = np.hypot(x, y), target.size("to")
    lit = gamma <= to if target.edge == 0.0 else 0.5 * erfc((gamma - to) / (np.sqrt(2.0) * target.edge))
    within = gamma < _HORIZON
    light: Degrees = np.where(within, lit / np.cos(np.radians(np.where(within, gamma, 0.0))) ** 3, 0.0)
    return light


def photometric(intensity: TabulatedIntensity, x: Degrees, y: Degrees) -> Degrees:
    """A table of intensities, bilinear over C and gamma, 0 beyond its last gamma."""
    gamma, azimuth = np.hypot(x, y), np.degrees(np.arctan2(y, x)) % 360.0
    angles, planes = intensity.gamma_deg, intensity.c_deg
    row = np.interp(gamma, angles, np.arange(len(angles)))
    column = np.interp(azimuth, planes, np.arange(len(planes))) if len(planes) > 1 else np.zeros_like(gamma)
    low, left = np.minimum(row.astype(int), len(angles) - 2), np.minimum(column.astype(int), max(len(planes) - 2, 0))
    up, right = row - low, column - left
    beside = np.minimum(left + 1, len(planes) - 1)
    values = intensity.values
    light = (1.0 - right) * ((1.0 - up) * values[left, low] + up * values[left, low + 1])
    light = light + right * ((1.0 - up) * values[beside, low] + up * values[beside, low + 1])
    return np.where((gamma >= angles[0]) & (gamma <= angles[-1]), light, 0.0)
