"""Light across a clear body of the scene, without the design's code: Snell and Fresnel by the angles at two faces.

Unpolarised light is two halves, across the plane of incidence and in it. At the second face, whose plane of incidence
is turned by an angle about the ray, each half is divided by the squares of its cosine and its sine.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

_UPRIGHT = 1e-9  # sine below which a ray has no plane of incidence

_Vectors = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]


class Bent(NamedTuple):
    """Rays behind a face: directions, unit vectors across the plane of incidence, both transmitted shares, and whether
    they pass."""

    directions: _Vectors
    across: _Vectors
    of_across: _Values
    of_along: _Values
    passes: Bool[np.ndarray, " n"]


def bent(directions: _Vectors, normals: _Vectors, ratio: _Values) -> Bent:
    """Behind a face of unit ``normals`` along the rays; ``ratio``: of the index before to that behind."""
    across = np.cross(normals, directions)
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
    aside = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    unit = np.where(upright[:, None], aside / np.linalg.norm(aside, axis=1)[:, None], unit)
    sideways = np.cross(unit, normals)
    onward = np.cos(behind)[:, None] * normals + np.where(upright, 0.0, np.sin(behind))[:, None] * sideways
    return Bent(onward, unit, 1.0 - r_across**2, 1.0 - r_along**2, passes)


def through(first: Bent, second: Bent) -> _Values:
    """Share of unpolarised light that passes two faces, one after the other."""
    cosine2 = np.sum(first.across * second.across, axis=1) ** 2
    halves = (
        first.of_across * (cosine2 * second.of_across + (1.0 - cosine2) * second.of_along),
        first.of_along * (cosine2 * second.of_along + (1.0 - cosine2) * second.of_across),
    )
    return np.where(first.passes & second.passes, 0.5 * (halves[0] + halves[1]), 0.0)
