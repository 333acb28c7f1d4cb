"""Light at the faces of a clear body of the scene, without the design's code: Snell and Fresnel by the angles.

Unpolarised light is two halves of their own. Each has two amplitudes, across the plane of incidence and along it; at
the next face, whose plane is turned about the ray, they are divided anew. Total reflection delays both, by
2 atan(b / cos i) and 2 atan(b / (m² cos i)), b² = sin² i - m², m the index behind over that before (Born and Wolf,
1.5.4).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

_UPRIGHT = 1e-9  # sine below which a ray has no plane of incidence

_Vectors = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]


class SwingingRays(NamedTuple):
    """Rays with the ``amplitudes`` of both halves (last axis) along unit vectors ``across`` them, and at right angles
    to both."""

    directions: _Vectors
    across: _Vectors
    amplitudes: Complex[np.ndarray, "n 2 2"]

    @staticmethod
    def unpolarised(directions: _Vectors) -> "SwingingRays":
        """Rays with as much light of either half."""
        halves = np.tile(np.eye(2) + 0.0j, (len(directions), 1, 1))
        return SwingingRays(directions, _aside(directions), halves)

    @property
    def share(self) -> _Values:
        """Share of the flux that is left."""
        return np.asarray(0.5 * (np.abs(self.amplitudes) ** 2).sum(axis=(1, 2)))

    def take(self, rows: Int[np.ndarray, " k"]) -> "SwingingRays":
        """Some of the rays."""
        return SwingingRays(*(column[rows] for column in self))

    def at_face(self, normals: _Vectors, ratio: _Values) -> "tuple[SwingingRays, Bool[np.ndarray, ' n']]":
        """Behind a face of unit ``normals`` along the rays, or reflected by it totally; and whether they pass it.

        ``ratio``: of the index before to that behind.
        """
        across = np.cross(normals, self.directions)
        sine = np.linalg.norm(across, axis=1)
        passes = ratio * sine < 1.0
        before, behind = (np.arcsin(np.minimum(value, 1.0)) for value in (sine, ratio * sine))
        upright = sine < _UPRIGHT
        with np.errstate(divide="ignore", invalid="ignore"):
            r_across = np.sin(before - behind) / np.sin(before + behind)
            r_along = np.tan(before - behind) / np.tan(before + behind)
            unit = across / sine[:, None]
        head_on = (ratio - 1.0) / (ratio + 1.0)
        r_across, r_along = (np.where(upright, head_on, value) for value in (r_across, r_along))
        unit = np.where(upright[:, None], _aside(normals), unit)
        sideways = np.cross(unit, normals)
        onward = np.cos(behind)[:, None] * normals + np.where(upright, 0.0, np.sin(behind))[:, None] * sideways
        back = sine[:, None] * sideways - np.cos(before)[:, None] * normals
        delays = _delays(before, sine, ratio)
        of_face = [
            np.where(passes, np.sqrt(np.maximum(1.0 - r**2, 0.0)), np.exp(-1.0j * delay))
            for r, delay in zip((r_across, r_along), delays, strict=True)
        ]
        amplitudes = self._about(unit) * np.stack(of_face, axis=1)[:, :, None]
        return SwingingRays(np.where(passes[:, None], onward, back), unit, amplitudes), passes

    def _about(self, unit: _Vectors) -> Complex[np.ndarray, "n 2 2"]:
        """Amplitudes along ``unit`` vectors, and at right angles to these and the rays."""
        cosine = np.sum(self.across * unit, axis=1)
        sine = np.sum(np.cross(self.directions, self.across) * unit, axis=1)
        turn = np.stack([np.stack([cosine, sine], axis=1), np.stack([-sine, cosine], axis=1)], axis=1)
        return np.asarray(turn @ self.amplitudes)


def _aside(vectors: _Vectors) -> _Vectors:
    """A unit vector at right angles to each unit vector."""
    aside = np.cross(vectors, np.eye(3)[np.abs(vectors).argmin(axis=1)])
    return np.asarray(aside / np.linalg.norm(aside, axis=1)[:, None])


def _delays(angles: _Values, sines: _Values, ratio: _Values) -> tuple[_Values, _Values]:
    """Delays (rad) across and along the plane of incidence by total reflection; 0 where light passes."""
    square = 1.0 / ratio**2
    beyond = np.sqrt(np.maximum(sines**2 - square, 0.0))
    cosines = np.cos(angles)
    return 2.0 * np.arctan2(beyond, cosines), 2.0 * np.arctan2(beyond, square * cosines)
