"""Largest share of a source's light that any lens of a given size brings into a part of a receiver."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.optics.etendue import cell_solid_angles, cone_around, etendue_from_ball, largest_deviation_rad
from lensforge.receivers.posed import PosedReceiver
from lensforge.sources.bundle import RayBundle
from lensforge.sources.etendue import EtendueCurve


@dataclass(frozen=True)
class LargestShare:
    """Upper bounds of a share of the source's flux: by étendue, and by the largest deviation in two refractions."""

    by_etendue: float
    by_refraction: float

    @property
    def value(self) -> float:
        """The lower one."""
        return min(self.by_etendue, self.by_refraction)

    def __str__(self) -> str:
        law = "étendue" if self.by_etendue <= self.by_refraction else "the largest deviation in two refractions"
        return f"at most {100.0 * self.value:.3g} % (by {law})"


def largest_share(
    rays: RayBundle,
    pixels: Bool[np.ndarray, "h w"],
    receiver: PosedReceiver,
    max_radius_mm: float,
    refractive_index: float,
) -> LargestShare:
    """Bound the share of the flux of ``rays`` that lands in ``pixels`` [row y, column x], by two laws.

    Étendue: the light comes out of the ball of ``max_radius_mm`` about the origin, so that what reaches the pixels has
    at most the étendue from the ball to them, and the flux of the brightest light of the source of that étendue.
    Refraction: two surfaces turn a ray by ``2 acos(1/n)`` at most. Fresnel losses come on top of both, and so does
    whatever the lens cannot do. 1 for a source without extent and an index that turns rays far enough.
    """
    if not pixels.any():
        return LargestShare(0.0, 0.0)
    corners = receiver.corners()
    solid_angle = float(cell_solid_angles(corners)[pixels].sum())
    held = EtendueCurve.of(rays).share_within(etendue_from_ball(max_radius_mm, solid_angle))
    axis, half_rad = cone_around(corners, pixels)
    indices = rays.refractive_indices
    index = refractive_index if indices is None else float(indices.max())
    within = half_rad + _parallax_rad(receiver, corners, max_radius_mm) + largest_deviation_rad(index)
    turned = np.arccos(np.clip(rays.directions @ axis, -1.0, 1.0)) <= within
    return LargestShare(held, float(rays.flux[turned].sum() / rays.flux.sum()))


def _parallax_rad(receiver: PosedReceiver, corners: Float[np.ndarray, "m n 3"], max_radius_mm: float) -> float:
    """Most by which a point of the receiver, seen from within the ball, lies off its direction from the origin."""
    if receiver.kind == "far_field":
        return 0.0
    nearest_mm = float(np.linalg.norm(corners, axis=-1).min())
    if receiver.kind == "plane":  # between the corners it may be nearer
        nearest_mm = abs(float(receiver.pose.axes[2] @ receiver.pose.centre_mm))
    return float(np.arcsin(min(1.0, max_radius_mm / nearest_mm)))
