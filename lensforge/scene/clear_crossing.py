"""Light that crosses a clear body of the scene: refracted at the triangle that it meets, and at that where it leaves.

Unpolarised where it comes, its polarisation goes along from face to face. What either face reflects in part stays in
the body; what is reflected totally goes on within.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Inexact

from lensforge.optics.dielectric import (
    fields_behind,
    fresnel_transmittances,
    passing_amplitudes,
    reflecting_amplitudes,
    refract,
    transmitted_cosine_squared,
)
from lensforge.scene.wall_reflection import mirrored

_Vectors = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]
_Fields = Inexact[np.ndarray, "n 2 3"]


class CrossedRays(NamedTuple):
    """Rays behind clear bodies: where they go on (mm), their directions, and the ``share`` of the flux that does."""

    places: _Vectors
    directions: _Vectors
    share: _Values


class RaysWithin(NamedTuple):
    """Rays within clear bodies: where they go on (mm), their directions, and their fields."""

    places: _Vectors
    directions: _Vectors
    fields: _Fields


def refracted(directions: _Vectors, fields: _Fields, normals: _Vectors, ratio: _Values) -> tuple[_Vectors, _Fields]:
    """Unit directions and fields behind a face; light that is totally reflected there goes on without any.

    ``normals``: along the rays; ``ratio``: index before over that behind.
    """
    cosine = (directions * normals).sum(axis=1)
    passes = transmitted_cosine_squared(cosine, ratio) > 0.0
    ratio = np.where(passes, ratio, 1.0)
    behind = refract(directions, normals, ratio)
    amplitudes = passing_amplitudes(fresnel_transmittances(cosine, ratio), ratio)
    passed = fields_behind(fields, directions, behind, normals, amplitudes)
    return behind, passed * passes[:, None, None]


def totally_reflected(
    directions: _Vectors, fields: _Fields, normals: _Vectors, ratio: _Values
) -> tuple[_Vectors, _Fields]:
    """Unit directions and fields, then complex, of light that a face reflects totally.

    ``normals``: along the rays; ``ratio``: index before over that behind.
    """
    amplitudes = reflecting_amplitudes((directions * normals).sum(axis=1), ratio)
    within = mirrored(directions, normals)
    return within, fields_behind(fields, directions, within, normals, amplitudes, reflected=True)
