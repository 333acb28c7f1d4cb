"""Derivatives of a face at a point, its normal, and its principal curvatures.

Curvatures are signed for the cutter: convex is positive, concave (a hollow that a ball must enter) negative. With the
air-side normal ``n`` the curvature along a unit tangent ``t`` is ``-x_tt . n``: a ball of glass has ``+1/r``, a
spherical cavity ``-1/r``, whichever face of the lens it is.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Jet:
    """Position (mm) over the chart and its first and second derivatives by the chart coordinates X and Y."""

    point: Float[np.ndarray, "n 3"]
    x: Float[np.ndarray, "n 3"]
    y: Float[np.ndarray, "n 3"]
    xx: Float[np.ndarray, "n 3"]
    xy: Float[np.ndarray, "n 3"]
    yy: Float[np.ndarray, "n 3"]

    @property
    def area_element(self) -> Float[np.ndarray, " n"]:
        """Area (mm^2) of the face for each unit of chart area."""
        area: Float[np.ndarray, " n"] = np.linalg.norm(np.cross(self.x, self.y), axis=1)
        return area

    @property
    def normal(self) -> Float[np.ndarray, "n 3"]:
        """Unit normals pointing away from the origin."""
        outward = np.cross(self.x, self.y)
        normal: Float[np.ndarray, "n 3"] = outward / np.linalg.norm(outward, axis=1, keepdims=True)
        return normal


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
