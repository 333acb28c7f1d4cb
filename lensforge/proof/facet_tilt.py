"""Facets of faces that scatter, as the casts through the part meet them.

Rays of the design come with the numbers of the facets that they meet, so that both are compared ray by ray; rays of the
proof's own meet facets of its own, drawn by NumPy's normal numbers from the slopes that the definitions state.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.optics.media import Media
from lensforge.sources.ray_bundle import RayBundle

Vectors = Float[np.ndarray, "n 3"]
Slopes = Float[np.ndarray, "n m"]  # two numbers for each face; none where all faces are polished


def slopes_of(rays: RayBundle, media: Media, names: Sequence[str], before: int = 0, seed: int | None = None) -> Slopes:
    """Slopes of the facets that ``rays`` meet at the faces of these ``names``, by the numbers that they have.

    ``before``: number of faces that scatter and that the rays have met before, on other bodies. ``seed``: of slopes of
    the proof's own in their place.
    """
    facets = media.facets(names)
    if facets is None:
        return np.zeros((len(rays), 0))
    rms = np.array([0.0 if each is None else each.slope for each in facets])
    if seed is not None:
        normal = np.random.default_rng([seed, before]).standard_normal((len(rays), 2 * len(names)))
    else:
        normal = _normal(rays, rms > 0.0, before)
    return normal * np.repeat(rms, 2)


def _normal(rays: RayBundle, rough: Bool[np.ndarray, " f"], before: int) -> Slopes:
    """Two normal numbers for each face from two even ones of each that is rough (Box and Muller, 1958)."""
    found, last = np.zeros((len(rays), 2 * len(rough))), 2 * (before + int(rough.sum()))
    if rays.facets is None or rays.facets.shape[1] < last:
        raise ValueError("rays come without the numbers of the facets that they meet")
    for number, face in enumerate(np.flatnonzero(rough), before):
        amount, turn = rays.facets[:, 2 * number], 2.0 * np.pi * rays.facets[:, 2 * number + 1]
        length = np.sqrt(-2.0 * np.log(1.0 - amount))
        found[:, 2 * face], found[:, 2 * face + 1] = length * np.cos(turn), length * np.sin(turn)
    return found


def tilted(
    normals: Vectors, points: Vectors, slopes: Slopes, faces: Int[np.ndarray, " n"], events: int | Int[np.ndarray, " n"]
) -> Vectors:
    """Unit normals of the facets at ``points`` of the part, from those of its ``faces``, of either sign.

    The two lines of a slope are x and y, turned to the face as z is to its normal away from the origin. A ray that
    meets a face again, at a later of its ``events``, meets a facet a right angle on.
    """
    rough = np.flatnonzero((faces >= 0) & (2 * faces + 2 <= slopes.shape[1]))
    if not len(rough):
        return normals
    n = normals[rough] * np.where(np.sum(normals[rough] * points[rough], axis=1) < 0.0, -1.0, 1.0)[:, None]
    along = slopes[rough, 2 * faces[rough]] + 1j * slopes[rough, 2 * faces[rough] + 1]
    along *= 1j ** (np.broadcast_to(events, len(faces))[rough] - faces[rough])
    axis = np.cross([0.0, 0.0, 1.0], n)  # of the turn, its length the sine of the angle
    flat = np.column_stack([along.real, along.imag, np.zeros(len(rough))])
    cosine = n[:, 2:]
    turned = cosine * flat + np.cross(axis, flat) + np.sum(axis * flat, axis=1)[:, None] * axis / (1.0 + cosine)
    found = normals.copy()
    found[rough] = (n + turned) / np.linalg.norm(n + turned, axis=1)[:, None]
    return found
