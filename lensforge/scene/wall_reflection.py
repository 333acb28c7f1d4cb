"""Directions of light behind a wall of the scene: by a mirror, or by Lambert's law, from the side from which it comes.

A diffuse wall of two numbers u, v in [0, 1) of a ray sends it along √u (cos 2πv **t** + sin 2πv **n** x **t**) +
√(1 - u) **n**, the density cos/π. **n** is the unit normal towards the light, **t** the direction of the ray along the
wall: no frame but that of wall and ray enters, so that turned scenes have turned light.
"""

import numpy as np
from jaxtyping import Float

from lensforge.optics.arrays import lengths

_ALONG_NORMAL = 1e-9  # sine of incidence below which a ray has no direction along the wall

_Vectors = Float[np.ndarray, "n 3"]


def towards_light(normals: _Vectors, directions: _Vectors) -> _Vectors:
    """Unit ``normals`` of either sign, turned against ``directions``."""
    ahead = (normals * directions).sum(axis=1, keepdims=True)
    return np.where(ahead > 0.0, -normals, normals)


def mirrored(directions: _Vectors, normals: _Vectors) -> _Vectors:
    """Unit ``directions`` behind mirrors of unit ``normals``."""
    return np.asarray(directions - 2.0 * (directions * normals).sum(axis=1, keepdims=True) * normals)


def diffused(directions: _Vectors, normals: _Vectors, draws: Float[np.ndarray, "n 2"]) -> _Vectors:
    """Unit directions behind diffuse walls of unit ``normals`` towards the light, by two numbers in [0, 1) of each."""
    along = directions - (directions * normals).sum(axis=1, keepdims=True) * normals
    sine = lengths(along)[:, None]
    aside = np.where(np.abs(normals[:, :1]) < 0.5, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    along = np.where(sine > _ALONG_NORMAL, along, np.cross(normals, aside))
    along /= lengths(along)[:, None]
    radius = np.sqrt(draws[:, :1])
    azimuth = 2.0 * np.pi * draws[:, 1:]
    across = radius * (np.cos(azimuth) * along + np.sin(azimuth) * np.cross(normals, along))
    return np.asarray(across + np.sqrt(1.0 - draws[:, :1]) * normals)
