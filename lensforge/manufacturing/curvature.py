"""Principal curvatures, signed for the cutter: convex is positive, concave (a hollow that a ball must enter) negative.

With the air-side normal ``n`` the curvature along a unit tangent ``t`` is ``-x_tt . n``: a ball of glass has ``+1/r``,
a spherical cavity ``-1/r``, whichever face of the lens it is.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.manufacturing.face import Jet, OpticalFace

_ZOOM_NODES = 21
_ZOOM_ROUNDS = 3


@dataclass(frozen=True)
class PrincipalCurvatures:
    """Signed principal curvatures (1/mm), ``minimum <= maximum``; concave is negative."""

    minimum: Float[np.ndarray, " n"]
    maximum: Float[np.ndarray, " n"]


def principal_curvatures(jet: Jet, normal: Float[np.ndarray, "n 3"]) -> PrincipalCurvatures:
    """Curvatures of a jet with air-side ``normal``: the second fundamental form in an orthonormal tangent frame.

    The frame (Gram-Schmidt on the chart's tangents) makes the shape operator symmetric, so its eigenvalues come from
    a hypot and stay exact at umbilics, where ``H^2 - K`` would lose half of the digits.
    """
    length_x = np.linalg.norm(jet.x, axis=1)
    skew = np.sum(jet.x * jet.y, axis=1) / length_x
    height = jet.area_element / length_x
    form_xx, form_xy, form_yy = (-np.sum(second * normal, axis=1) for second in (jet.xx, jet.xy, jet.yy))
    along = form_xx / length_x**2
    cross = (form_xy / length_x - along * skew) / height
    across = (form_yy - 2.0 * cross * height * skew - along * skew**2) / height**2
    mean, deviator = (along + across) / 2.0, np.hypot((along - across) / 2.0, cross)
    return PrincipalCurvatures(mean - deviator, mean + deviator)


def smallest_curvature(face: OpticalFace, start: Float[np.ndarray, "2"], step: float) -> float:
    """The lowest curvature (1/mm) within ``step`` of chart point ``start``, by zooming in; never outside the rim."""
    centre, lowest = np.array(start, dtype=np.float64), np.inf
    for _ in range(_ZOOM_ROUNDS):
        axis = np.linspace(-step, step, _ZOOM_NODES)
        window = centre + np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
        window = window / np.maximum(1.0, np.linalg.norm(window, axis=1, keepdims=True))
        jet = face.jet(window)
        kappa = principal_curvatures(jet, face.air_normal(jet)).minimum
        best = int(np.argmin(kappa))
        centre, lowest = window[best], min(lowest, float(kappa[best]))
        step *= 2.0 / (_ZOOM_NODES - 1)
    return lowest
