"""Rendered photographs of a lit panel: known corners, perspective, room light, vignetting, a lens's blur, noise."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

TARGET_MM = 300.0
# Top left, top right, bottom right, bottom left: a camera that looks from the left below, a little rolled.
CORNERS = np.array([[86.3, 50.7], [391.6, 74.2], [370.9, 331.4], [65.8, 295.1]])
SIZE = (470, 380)
_SUPERSAMPLED = 3
_RENDERED = {}


def cross(x, y):
    upright, across = ((np.abs(u) < 12.0) & (np.abs(v) < 60.0) for u, v in ((x, y), (y, x)))
    return (upright | across).astype(float)


def pi(x, y):
    top = (np.abs(x) < 55.0) & (np.abs(y - 40.0) < 9.0)
    legs = (np.abs(np.abs(x) - 28.0) < 9.0) & (y < 40.0) & (y > -50.0)
    return (top | legs).astype(float)


def flat_top(x, y):
    return ((np.abs(x) < 70.0) & (np.abs(y) < 70.0)).astype(float)


def letter(x, y):
    """An F: no turn and no mirror image of it is the same."""
    stem = (np.abs(x + 30.0) < 9.0) & (np.abs(y) < 60.0)
    bars = (np.abs(x - 5.0) < 40.0) & ((np.abs(y - 51.0) < 9.0) | (np.abs(y) < 9.0))
    return (stem | bars).astype(float)


PATTERNS = {"cross": cross, "pi": pi, "flat top": flat_top, "letter": letter}


def homography(corners, size=(TARGET_MM, TARGET_MM)):
    """Rows of the direct linear transform from mm to pixels: written for the tests alone."""
    a, b, rows = size[0] / 2, size[1] / 2, []
    for (x, y), (u, v) in zip([(-a, b), (a, b), (a, -b), (-a, -b)], corners, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y, -u], [0, 0, 0, x, y, 1, -v * x, -v * y, -v]]
    return np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3)


@dataclass(frozen=True)
class Scene:
    """A white panel before a darker wall. ``room``: light without the LED; ``bow``: barrel distortion at the corner.

    ``board``: brightness of a larger square behind the panel, where there is one.
    """

    pattern: str = "cross"
    corners: np.ndarray = None
    room: float = 0.06
    wall: float = 0.3
    spill: float = 0.01
    vignetting: float = 0.4
    blur: float = 1.2
    noise: float = 0.004
    bow: float = 0.0
    board: float = 0.0

    def light(self, lit):
        """Linear light by pixel, with (``lit``) or without the LED's; each picture is rendered once."""
        fields = {**vars(self), "corners": str(self.corners), "lit": lit}
        if not lit:
            fields.update(pattern="", spill=0.0)
        key = tuple(fields.values())
        if key not in _RENDERED:
            _RENDERED[key] = self._rendered(lit)
            _RENDERED[key].flags.writeable = False
        return _RENDERED[key]

    def _rendered(self, lit):
        factor, (width, height) = _SUPERSAMPLED, SIZE
        columns, rows = ((np.arange(n * factor) + 0.5) / factor - 0.5 for n in (width, height))
        u, v = np.meshgrid(columns, rows)
        centre = np.array([width - 1, height - 1]) / 2
        radius2 = ((u - centre[0]) ** 2 + (v - centre[1]) ** 2) / (centre**2).sum()
        distorted = 1.0 + self.bow * radius2
        u, v = centre[0] + (u - centre[0]) * distorted, centre[1] + (v - centre[1]) * distorted
        corners = CORNERS if self.corners is None else self.corners
        x, y, w = np.linalg.inv(homography(corners)) @ np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
        x, y = (x / w).reshape(u.shape), (y / w).reshape(u.shape)
        panel = np.maximum(np.abs(x), np.abs(y)) < TARGET_MM / 2
        led = 0.75 * gaussian_filter(PATTERNS[self.pattern](x, y), 2.0) + self.spill if lit else 0.0
        gradient = 1.0 + 0.3 * u / width - 0.2 * v / height
        behind = np.where(np.maximum(np.abs(x), np.abs(y)) < 0.6 * TARGET_MM, self.board or self.wall, self.wall)
        seen = np.where(panel, 0.85, behind) * (self.room * gradient + led)
        seen = gaussian_filter(seen, self.blur * factor) / (1.0 + self.vignetting * radius2) ** 2
        return seen.reshape(height, factor, width, factor).mean(axis=(1, 3))

    def pictures(self, seed=0):
        """Photographs on and off with noise, clipped to full scale 1."""
        random = np.random.default_rng(seed)
        return [np.clip(self.light(lit) + self.noise * random.normal(size=SIZE[::-1]), 0, 1) for lit in (True, False)]
