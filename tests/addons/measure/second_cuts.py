"""A machine with a form error of its own, which cuts, and cuts again from a corrected STEP file."""

import numpy as np
from scipy.interpolate import RectBivariateSpline

from lensforge.cad.form_error import face_points
from lensforge.cad.plan import INNER, OUTER
from lensforge.cad.step import parse_step
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import HALF_WIDTH, Surface, grid, to_chart

_NODES = 161


def machine_error(u, radius_mm, size_mm=1e-3, wave_mm=2.5):
    """Radial error (mm): low orders, and a wave of ``wave_mm`` along arcs of a sphere; about 5 ``size_mm`` at most."""
    x, y, z = u.T
    low = 1.6 * (x * x - y * y) + 2.4 * x * y * z + 1.5 * (x**3 - 3.0 * x * y * y) + 2.5 * z**3 - 1.5 * z
    angle = np.arctan2(0.8 * x + 0.6 * y, np.hypot(z, 0.8 * y - 0.6 * x))
    return size_mm * (low + np.cos(2.0 * np.pi * radius_mm * angle / wave_mm))


def measured(of, error, count, noise_mm=3e-4, seed=3):
    """Points on a spiral pattern over the face with a radial error, with the noise of a probe along its normals."""
    u = fibonacci_hemisphere(count)
    noise = noise_mm * np.random.default_rng(seed + 1).normal(size=count)
    return u * (of.radius(u) + error(u))[:, None] + noise[:, None] * of.normal(u)


def motions(of, u):
    """Changes along the normal of the surface by small rigid motions: rotations, then translations."""
    normals = of.normal(u)
    return np.concatenate([np.cross(u * of.radius(u)[:, None], normals), normals], axis=1)


def cosine(of, u):
    """Cosine between rays and normals: as much of a radial change lies along the normal."""
    return np.sum(of.normal(u) * u, axis=1)


def without_motion(of, error):
    """``error`` less the rigid motion of the surface that is nearest to it."""
    u = fibonacci_hemisphere(4000)
    motion = np.linalg.lstsq(motions(of, u), error(u) * cosine(of, u), rcond=None)[0]
    return lambda at: error(at) - motions(of, at) @ motion / cosine(of, at)


class CutAgain(Surface):
    """Radial error (mm) of the part that the same machine cuts from a STEP file, read back by the CAD kernel."""

    detail_rad = 0.05

    def __init__(self, step, side, of, error):
        face = parse_step(step).faces[{"inner": INNER, "outer": OUTER}[side]]
        chart = grid(_NODES)
        points, _ = face_points(face, chart.reshape(-1, 2))
        nominal = of.radius(points / np.linalg.norm(points, axis=1)[:, None])
        axis = chart[:, 0, 0]
        self.change = RectBivariateSpline(
            axis, axis, (np.linalg.norm(points, axis=1) - nominal).reshape(_NODES, _NODES), kx=5, ky=5
        )
        self.of, self.error = of, error

    def radius(self, u):
        chart = np.clip(to_chart(u), -HALF_WIDTH, HALF_WIDTH)
        return self.error(u) + self.change.ev(chart[:, 0], chart[:, 1])

    def gradient(self, u):
        raise NotImplementedError

    def along_normals(self, u):
        """The error along the normal (mm)."""
        return self.radius(u) * cosine(self.of, u)
