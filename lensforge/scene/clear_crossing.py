"""Light that crosses a clear body of the scene: refracted at the triangle that it meets, and at that where it leaves.

Unpolarised where it comes, its polarisation goes along from face to face. What either face reflects, and what is
reflected totally within, stays in the body.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.optics.dielectric import (
    fields_behind,
    fresnel_transmittances,
    passing_amplitudes,
    refract,
    transmitted_cosine_squared,
)

_Vectors = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]
_Fields = Float[np.ndarray, "n 2 3"]


class CrossedRays(NamedTuple):
    """Rays behind clear bodies: where they go on (mm), their directions, and the ``share`` of the flux that does."""

    places: _Vectors
    directions: _Vectors
    share: _Values


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
