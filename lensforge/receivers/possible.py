"""Largest share of a source's light that any lens of a given size brings into a part of a plane receiver."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.optics.etendue import cell_solid_angles, cone_around, etendue_from_ball, largest_deviation_rad
from lensforge.receivers.pixels import PixelGrid
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
    pixels: Bool[np.ndarray, "p p"],
    grid: PixelGrid,
    distance_mm: float,
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
    edges = _edges_mm(grid)
    solid_angle = float(cell_solid_angles(edges, edges, distance_mm)[pixels].sum())
    held = EtendueCurve.of(rays).share_within(etendue_from_ball(max_radius_mm, solid_angle))
    turned = _turned_share(rays, pixels, edges, distance_mm, max_radius_mm, refractive_index)
    return LargestShare(held, turned)


def _turned_share(
    rays: RayBundle,
    pixels: Bool[np.ndarray, "p p"],
    edges_mm: Float[np.ndarray, " e"],
    distance_mm: float,
    max_radius_mm: float,
    refractive_index: float,
) -> float:
    """Share of the flux whose direction two refractions can turn towards the pixels from some point of the ball."""
    axis, half_rad = cone_around(edges_mm, edges_mm, distance_mm, pixels)
    indices = rays.refractive_indices
    index = refractive_index if indices is None else float(indices.max())
    # seen from within the ball, a point of the plane lies off its direction from the origin by this much at most
    parallax_rad = float(np.arcsin(min(1.0, max_radius_mm / distance_mm)))
    angles = np.arccos(np.clip(rays.directions @ axis, -1.0, 1.0))
    within = angles <= half_rad + parallax_rad + largest_deviation_rad(index)
    return float(rays.flux[within].sum() / rays.flux.sum())


def _edges_mm(grid: PixelGrid) -> Float[np.ndarray, " e"]:
    edges: Float[np.ndarray, " e"] = (np.arange(grid.pixels + 1) / grid.pixels - 0.5) * grid.side_mm
    return edges
