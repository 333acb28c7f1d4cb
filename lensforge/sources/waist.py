"""The waist of rays: the height at which their lines lie closest together, which locates the LED of a ray file."""

import numpy as np
from jaxtyping import Float

from lensforge.sources.ray_bundle import RayBundle


def waist_mm(rays: RayBundle) -> float:
    """Height (mm) of the plane z = const in which the lines of ``rays``, none of them level, lie closest together."""
    slopes = rays.directions[:, :2] / rays.directions[:, 2:]
    weights = (rays.flux * rays.directions[:, 2] ** 4)[:, None]  # rays near the horizon cross every plane far out
    total = max(float(weights.sum()), np.finfo(float).tiny)
    crossings = rays.origins[:, :2] - rays.origins[:, 2:] * slopes
    apart, turned = (values - (weights * values).sum(axis=0) / total for values in (crossings, slopes))
    spread = float((weights * turned**2).sum())
    return 0.0 if spread == 0.0 else -float((weights * apart * turned).sum()) / spread


def at_height(rays: RayBundle, z_mm: float) -> Float[np.ndarray, "n 3"]:
    """Points (mm) in which the lines of ``rays``, none of them level, cross the plane of this height."""
    along = (z_mm - rays.origins[:, 2]) / rays.directions[:, 2]
    points: Float[np.ndarray, "n 3"] = rays.origins + along[:, None] * rays.directions
    return points
