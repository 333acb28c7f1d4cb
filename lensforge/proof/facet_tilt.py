"""Facets of faces that scatter, as the casts through the part meet them, and numbers for all faces that scatter.

Rays of the design come with the numbers of the faces that they meet, so that both are compared ray by ray; the proof's
own rays have other numbers. For a second hit of the same face the numbers come from a hash that the definitions state.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Int, UInt64
from scipy.special import ndtr

from lensforge.optics.media import Media, RingScatter
from lensforge.sources.ray_bundle import RayBundle

Vectors = Float[np.ndarray, "n 3"]
PerRay = Float[np.ndarray, " n"]
Numbers = Float[np.ndarray, "n k"]
Keys = UInt64[np.ndarray, " n"]

_HALVINGS = 60
_WIDEST = 1.2  # of what is seen over the greater of 0 and the number that is drawn
# Steele, Lea and Flood, 2014
_GOLDEN = 0x9E3779B97F4A7C15
_FIRST = 0xBF58476D1CE4E5B9
_SECOND = 0x94D049BB133111EB
_FACES = 256


class Arrival(NamedTuple):
    """Rays at faces: points (mm), unit normals of either sign, and unit directions before."""

    points: Vectors
    normals: Vectors
    directions: Vectors


class FaceNumbers(NamedTuple):
    """Two uniform numbers in [0, 1) of each ray for the first hit of each face, and keys for all later hits.

    Empty if no face scatters.
    """

    numbers: Numbers
    keys: Keys

    @staticmethod
    def of(
        rays: RayBundle, media: Media, names: Sequence[str], before: int = 0, seed: int | None = None
    ) -> "FaceNumbers":
        """Numbers with which ``rays`` meet the faces of these ``names``.

        ``before``: number of faces that scatter and that the rays have met before, on other bodies. ``seed``: of
        numbers of the proof's own in their place.
        """
        models = media.scattering_of(names)
        if models is None:
            return FaceNumbers(np.zeros((len(rays), 0)), np.zeros(len(rays), dtype=np.uint64))
        if seed is None:
            rough = np.array([model is not None for model in models])
            return FaceNumbers(_even(rays, rough, before), _keys(rays))
        random = np.random.default_rng([seed, before])
        return FaceNumbers(
            random.random((len(rays), 2 * len(names))), random.integers(2**64, size=len(rays), dtype=np.uint64)
        )

    def take(self, rows: Int[np.ndarray, " k"]) -> "FaceNumbers":
        """Select rays by row."""
        return FaceNumbers(self.numbers[rows], self.keys[rows])

    def at(self, faces: Int[np.ndarray, " n"], times: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
        """Numbers of each ray for its face after ``times`` earlier hits; 0 for no face."""
        drawn = np.zeros((len(faces), 2))
        rows = np.flatnonzero((faces >= 0) & (2 * faces < self.numbers.shape[1]))
        for column in (0, 1):
            drawn[rows, column] = self.numbers[rows, 2 * faces[rows] + column]
        repeated = rows[times[rows] > 0]
        drawn[repeated] = _hashed(self.keys[repeated], faces[repeated], times[repeated])
        return drawn


def facet_slopes(media: Media, names: Sequence[str]) -> Float[np.ndarray, " f"]:
    """Rms slope of the facets of each face, 0 for a polished one; the last entry, of index -1, is for no face."""
    models = media.scattering_of(names) or (None,) * len(names)
    return np.array(
        [0.0 if model is None or isinstance(model, RingScatter) else model.slope for model in (*models, None)]
    )


def _even(rays: RayBundle, rough: Bool[np.ndarray, " f"], before: int) -> Numbers:
    """Two uniform numbers for each face; for rough faces those of the design's rays."""
    drawn = np.zeros((len(rays), 2 * len(rough)))
    last = 2 * (before + int(rough.sum()))
    if rays.facets is None or rays.facets.shape[1] < last:
        raise ValueError("rays come without the numbers of the facets that they meet")
    for number, face in enumerate(np.flatnonzero(rough), before):
        drawn[:, 2 * face : 2 * face + 2] = rays.facets[:, 2 * number : 2 * number + 2]
    return drawn


def _keys(rays: RayBundle) -> Keys:
    """Hash of the bits with which each ray begins."""
    key = np.zeros(len(rays), dtype=np.uint64)
    golden = np.uint64(_GOLDEN)
    starts, ways = (np.ascontiguousarray(vectors).view(np.uint64) for vectors in (rays.origins, rays.directions))
    for column in np.column_stack([starts, ways])[:, [0, 3, 1, 4, 2, 5]].T:
        key = _mixed((key + golden) ^ column)
    return key


def _hashed(keys: Keys, faces: Int[np.ndarray, " n"], times: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
    """Two numbers in [0, 1) of 53 bits."""
    golden = np.uint64(_GOLDEN)
    stream = _mixed((keys + golden) ^ (_FACES * times + faces).astype(np.uint64))
    both = np.stack([_mixed(stream + golden), _mixed(stream + golden + golden)], axis=1)
    return (both >> np.uint64(11)).astype(float) / 2.0**53


def _mixed(key: Keys) -> Keys:
    key = (key ^ (key >> np.uint64(30))) * np.uint64(_FIRST)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(_SECOND)
    return key ^ (key >> np.uint64(31))


def tilted(met: Arrival, rms: PerRay, numbers: Float[np.ndarray, "n 2"]) -> Vectors:
    """Unit normals of the facets that rays meet on faces of ``rms`` slope, by their ``numbers``.

    Both components of a slope are x and y, turned to the face as z is to its normal away from the origin. Light sees
    more of the facets that face it: the visible slope is the quantile of the drawn slope.
    """
    rough = np.flatnonzero(rms > 0.0)
    if not len(rough):
        return met.normals
    normals = met.normals[rough]
    d = met.directions[rough]
    s = rms[rough]
    n = normals * np.where(np.sum(normals * met.points[rough], axis=1) < 0.0, -1.0, 1.0)[:, None]
    length = np.sqrt(-2.0 * np.log1p(-numbers[rough, 0]))
    turn = 2.0 * np.pi * numbers[rough, 1]
    drawn = in_face(length * np.exp(1j * turn), n)
    cosine = np.sum(d * n, axis=1)
    along = (d - cosine[:, None] * n) * np.where(cosine < 0.0, -1.0, 1.0)[:, None]
    sine = np.linalg.norm(along, axis=1)
    along /= np.where(sine > 0.0, sine, 1.0)[:, None]
    a = np.sum(drawn * along, axis=1)
    slopes = drawn + (_seen(a, np.abs(cosine) / np.maximum(s * sine, 1e-300)) - a)[:, None] * along
    facets = n + s[:, None] * slopes
    normals = met.normals.copy()
    normals[rough] = facets / np.linalg.norm(facets, axis=1)[:, None]
    return normals


def _seen(a: PerRay, k: PerRay) -> PerRay:
    """Quantile of the density (k + x) exp(-x^2/2) at the probability of normal numbers below a."""
    k = np.minimum(k, 1e9)
    is_high = a > 0.0  # then by the area above the number, else by that below: the smaller one is known to more digits
    side = np.where(is_high, -1.0, 1.0)
    wanted = (k * ndtr(k) + _bell(k)) * ndtr(side * a) + np.where(is_high, 0.0, k * ndtr(-k) - _bell(k))
    low, high = np.maximum(a, -k), np.maximum(a, 0.0) + _WIDEST
    for _ in range(_HALVINGS):
        x = 0.5 * (low + high)
        beyond = k * ndtr(side * x) - side * _bell(x)
        less = np.where(is_high, beyond > wanted, beyond < wanted)
        low, high = np.where(less, x, low), np.where(less, high, x)
    return 0.5 * (low + high)


def _bell(x: PerRay) -> PerRay:
    density: PerRay = np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi)
    return density


def in_face(slopes: Complex[np.ndarray, " n"], outward: Vectors) -> Vectors:
    """Vectors along faces: x and y turned by the rotation from z to the unit normal away from the origin."""
    axis = np.cross([0.0, 0.0, 1.0], outward)  # of the turn: its length is the sine of the angle
    cosine = outward[:, 2:]
    flat = np.column_stack([slopes.real, slopes.imag, np.zeros(len(slopes))])
    return cosine * flat + np.cross(axis, flat) + np.sum(axis * flat, axis=1)[:, None] * axis / (1.0 + cosine)
