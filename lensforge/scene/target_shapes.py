"""Relative light of each target at places about its centre: ``x`` and ``y`` (mm or degrees) that broadcast.

Sharp edges are sharp here; they are softened, and averaged over pixels, where the places are pixels. Targets of the far
field are relative intensities at angles along x and y.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import erfc

from lensforge.sources.intensity import TabulatedIntensity
from lensforge.spec.shape_targets import (
    CrossTarget,
    DiscTarget,
    EllipseTarget,
    FlatTopTarget,
    PolygonTarget,
    RectangleTarget,
    RingTarget,
    SpotsTarget,
)
from lensforge.spec.target_sections import ArrayTarget, BatwingTarget, BeamTarget, ImageTarget, TableTarget, TextTarget

Places = Float[np.ndarray, "..."]
Lit = Bool[np.ndarray, "..."]
Shape = RectangleTarget | DiscTarget | EllipseTarget | RingTarget | PolygonTarget | CrossTarget | SpotsTarget
PictureTarget = TextTarget | ImageTarget | ArrayTarget | TableTarget


def flat_top(target: FlatTopTarget, x: Places, y: Places) -> Places:
    """A super-Gaussian."""
    half_width, half_height = (0.5 * side for side in target.widths)
    with np.errstate(over="ignore"):  # far outside a narrow pattern: exp(-inf) is the 0 that is meant
        along_x = np.exp(-(np.abs(x / half_width) ** target.exponent))
        along_y = np.exp(-(np.abs(y / half_height) ** target.exponent))
    light: Places = along_y * along_x
    return light


def in_shape(target: Shape, x: Places, y: Places) -> Lit:
    """True inside a shape."""
    match target:
        case RectangleTarget():
            return _rectangle(x, y, target.size("width"), target.size("height"))
        case DiscTarget():
            return _ellipse(x, y, target.size("diameter"), target.size("diameter"))
        case EllipseTarget():
            return _ellipse(x, y, target.size("width"), target.size("height"))
        case RingTarget():
            outer, inner = target.size("outer_diameter"), target.size("inner_diameter")
            return np.asarray(_ellipse(x, y, outer, outer) & ~_ellipse(x, y, inner, inner))
        case CrossTarget():
            length, stroke = target.size("length"), target.size("stroke")
            return np.asarray(_rectangle(x, y, length, stroke) | _rectangle(x, y, stroke, length))
        case SpotsTarget():
            pitch, diameter = target.size("pitch"), target.size("diameter")
            return _ellipse(_from_spot(x, pitch, target.columns), _from_spot(y, pitch, target.rows), diameter, diameter)
        case PolygonTarget():
            return _polygon(target.corners, x, y)


def _rectangle(x: Places, y: Places, width: float, height: float) -> Lit:
    inside: Lit = (np.abs(y) <= height / 2.0) & (np.abs(x) <= width / 2.0)
    return inside


def _ellipse(x: Places, y: Places, width: float, height: float) -> Lit:
    inside: Lit = (2.0 * x / width) ** 2 + (2.0 * y / height) ** 2 <= 1.0
    return inside


def _from_spot(x: Places, pitch: float, count: int) -> Places:
    """Coordinate from the nearest of ``count`` centres."""
    place = x / pitch + 0.5 * (count - 1)
    off: Places = pitch * (place - np.clip(np.round(place), 0, count - 1))
    return off


def _polygon(corners: tuple[tuple[float, float], ...], x: Places, y: Places) -> Lit:
    """True where a ray to +x crosses the outline an odd number of times."""
    inside: Lit = np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y)), dtype=bool)
    for (x1, y1), (x2, y2) in zip(corners, (*corners[1:], corners[0]), strict=True):
        if y1 != y2:
            crosses = (y1 > y) != (y2 > y)
            inside ^= crosses & (x < x1 + (y - y1) * ((x2 - x1) / (y2 - y1)))
    return inside


def in_picture(picture: Float[np.ndarray, "h w"], size: tuple[float, float], x: Places, y: Places) -> Places:
    """A picture of ``size``, nearest pixel, 0 outside; row 0 of it is its top."""
    height, width = picture.shape
    framed = np.pad(picture, 1)
    # clipped to the frame: far from a narrow picture the index would overflow
    column = np.clip(np.floor(x * (width / size[0]) + width / 2.0) + 1.0, 0.0, width + 1.0).astype(int)
    row = np.clip(np.floor(-y * (height / size[1]) + height / 2.0) + 1.0, 0.0, height + 1.0).astype(int)
    light: Places = framed[row, column]
    return light


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
