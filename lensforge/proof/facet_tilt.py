"""Facets of faces that scatter, as the casts through the part meet them, and numbers for faces that do so by rings.

Rays of the design come with the numbers of the facets that they meet, so that both are compared ray by ray; rays of the
proof's own meet facets of its own, drawn by NumPy's normal numbers from the slopes that the definitions state.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from lensforge.optics.media import Media, RingScatter
from lensforge.sources.ray_bundle import RayBundle

Vectors = Float[np.ndarray, "n 3"]
Slopes = Float[np.ndarray, "n m"]  # three numbers for each face, the rms last; none where no face has facets
Numbers = Float[np.ndarray, "n k"]  # two for each face; none where no face scatters by rings


class Arrival(NamedTuple):
    """Rays at faces: points (mm), unit normals of either sign, and unit directions before."""

    points: Vectors
    normals: Vectors
    directions: Vectors


def slopes_of(rays: RayBundle, media: Media, names: Sequence[str], before: int = 0, seed: int | None = None) -> Slopes:
    """Slopes of the facets that ``rays`` meet at the faces of these ``names``, by the numbers that they have.

    ``before``: number of faces that scatter and that the rays have met before, on other bodies. ``seed``: of slopes of
    the proof's own in their place.
    """
    models = media.scattering_of(names)
    if models is None or all(each is None or isinstance(each, RingScatter) for each in models):
        return np.zeros((len(rays), 0))
    rms = np.array([0.0 if each is None or isinstance(each, RingScatter) else each.slope for each in models])
    if seed is not None:
        normal = np.random.default_rng([seed, before]).standard_normal((len(rays), 2 * len(names)))
    else:
        even = _even(rays, np.array([each is not None for each in models]), before)
        length, turn = np.sqrt(-2.0 * np.log(1.0 - even[:, ::2])), 2.0 * np.pi * even[:, 1::2]  # Box and Muller, 1958
        normal = np.stack([length * np.cos(turn), length * np.sin(turn)], axis=2).reshape(even.shape)
    slopes = np.empty((len(rays), len(names), 3))
    slopes[:, :, :2], slopes[:, :, 2] = normal.reshape(len(rays), -1, 2) * rms[:, None], rms
    return slopes.reshape(len(rays), -1)


def numbers_for_rings(
    rays: RayBundle, media: Media, names: Sequence[str], before: int = 0, seed: int | None = None
) -> Numbers:
    """Two even numbers in [0, 1) of each ray for each of its faces; none where no face scatters by rings.

    Arguments as of :func:`slopes_of`.
    """
    models = media.scattering_of(names)
    if models is None or not media.has_rings:
        return np.zeros((len(rays), 0))
    if seed is not None:
        return np.random.default_rng([seed, before]).random((len(rays), 2 * len(names)))
    return _even(rays, np.array([each is not None for each in models]), before)


def _even(rays: RayBundle, rough: Bool[np.ndarray, " f"], before: int) -> Numbers:
    """Two even numbers for each face, those with which the rays come for each that is rough."""
    found, last = np.zeros((len(rays), 2 * len(rough))), 2 * (before + int(rough.sum()))
    if rays.facets is None or rays.facets.shape[1] < last:
        raise ValueError("rays come without the numbers of the facets that they meet")
    for number, face in enumerate(np.flatnonzero(rough), before):
        found[:, 2 * face : 2 * face + 2] = rays.facets[:, 2 * number : 2 * number + 2]
    return found


def tilted(met: Arrival, slopes: Slopes, faces: Int[np.ndarray, " n"], events: int | Int[np.ndarray, " n"]) -> Vectors:
    """Unit normals of the facets that rays meet on these ``faces``.

    The two lines of a slope are x and y, turned to the face as z is to its normal away from the origin. A ray that
    meets a face again, at a later of its ``events``, meets a facet a right angle on. Light sees more of the facets that
    face it: their mean slope is along the face as the light is.
    """
    rough = np.flatnonzero((faces >= 0) & (3 * faces + 3 <= slopes.shape[1]))
    if not len(rough):
        return met.normals
    normals, d = met.normals[rough], met.directions[rough]
    n = normals * np.where(np.sum(normals * met.points[rough], axis=1) < 0.0, -1.0, 1.0)[:, None]
    a, b, rms = (slopes[rough, 3 * faces[rough] + column] for column in range(3))
    along = (a + 1j * b) * 1j ** (np.broadcast_to(events, len(faces))[rough] - faces[rough])
    cosine = np.sum(d * n, axis=1)
    seen = rms * np.sign(cosine) / np.sqrt((cosine / np.maximum(rms, 1e-9)) ** 2 + (1.0 - cosine**2) * 2.0 / np.pi)
    facets = n + in_face(along, n) + seen[:, None] * (d - cosine[:, None] * n)
    found = met.normals.copy()
    found[rough] = facets / np.linalg.norm(facets, axis=1)[:, None]
    return found


def in_face(slopes: Complex[np.ndarray, " n"], outward: Vectors) -> Vectors:
    """Vectors along faces: x and y turned to the face as z is to its unit normal away from the origin."""
    axis, cosine = (
        np.cross([0.0, 0.0, 1.0], outward),
        outward[:, 2:],
    )  # of the turn: its length is the sine of the angle
    flat = np.column_stack([slopes.real, slopes.imag, np.zeros(len(slopes))])
    return cosine * flat + np.cross(axis, flat) + np.sum(axis * flat, axis=1)[:, None] * axis / (1.0 + cosine)
