"""Correction of a face that its ball cutter can still follow: smoothed more where it would be concave too tightly."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.geometry.curvature import principal_curvatures
from lensforge.geometry.patch import fit_patch
from lensforge.manufacturing.face import OpticalFace
from lensforge.measurement.areal_filter import FilteredPoints
from lensforge.measurement.correction_result import KEPT
from lensforge.measurement.radial_change import ChangedSurface, RadialChange
from lensforge.surfaces.chart import HALF_WIDTH, to_sphere
from lensforge.surfaces.surface import Surface

_STIFFER = 16.0  # doubles the wavelength there
_ROUNDS = 8  # then it is 256 times as long: the change is straight there, and the face has the design's curvature
_REACH = 0.5  # wavelengths around a tight place are smoothed with it, so that the tightness does not move aside


@dataclass(frozen=True)
class CutFace:
    """The change (mm) that a cutter allows, the filtered deviation behind it, and the share of the area in which that
    has a longer wavelength for the cutter's sake.
    """

    change: RadialChange
    filtered: FilteredPoints
    smoothed_more_share: float


def limited_by_cutter(
    surface: Surface, face: OpticalFace, filtered: FilteredPoints, gain: float, cutter_radius_mm: float
) -> CutFace:
    """Mirror the filtered deviation times ``gain``, with a longer wavelength where the cutter asks for it.

    No place may be concave more tightly than the ball, or than the design where that is tighter already, by more than
    :data:`KEPT`. ``face``: the design's, from its air side.
    """
    areal = filtered.areal
    inside = np.sum(areal.places**2, axis=1) <= HALF_WIDTH**2  # the rim too
    places = areal.places[inside]
    allowed = np.minimum(_lowest(face, places), -1.0 / cutter_radius_mm) * (1.0 + KEPT)
    points = surface.radius(to_sphere(places))[:, None] * to_sphere(places)
    stiffness = np.ones(len(inside))
    change = filtered.change.times(-gain)
    for _ in range(_ROUNDS):
        corrected = OpticalFace(fit_patch(ChangedSurface(surface, change)), face.air)
        tight = _lowest(corrected, places) < allowed
        if not tight.any():
            break
        distance, _ = cKDTree(points[tight]).query(points)
        stiffness[inside] *= np.where(distance <= _REACH * areal.wavelength_mm, _STIFFER, 1.0)
        filtered = areal.solve(stiffness)
        change = filtered.change.times(-gain)
    areas = areal.place_areas[inside]
    return CutFace(change, filtered, float(areas[stiffness[inside] > 1.0].sum() / areas.sum()))


def _lowest(face: OpticalFace, places: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, " p"]:
    """Lowest curvature (1/mm) at chart points, from the air side: concave is negative."""
    jet = face.jet(places)
    return principal_curvatures(jet, face.air_normal(jet)).minimum
