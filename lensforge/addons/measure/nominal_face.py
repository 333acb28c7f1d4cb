"""A face as designed, over which deviations are measured, and the pixels of maps over it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.addons.measure.measurement_result import area_extent
from lensforge.cad.boundary import WHOLE, Domain, domain_of
from lensforge.cad.patch import Patch, fit_patch
from lensforge.results import Extent
from lensforge.scene.lens import Lens
from lensforge.spec.tolerances_section import PLACEMENT
from lensforge.surfaces.surface import Surface, to_sphere

_MAP_PIXELS = 201
_SAME = 1e-12  # of the chart


@dataclass(frozen=True)
class FacePixels:
    """Pixels of the chart inside the rim: their area (mm^2), and maps of radial changes along the normal (um)."""

    axis: Float[np.ndarray, " m"]
    area_mm2: Float[np.ndarray, "m m"]
    directions: Float[np.ndarray, "k 3"]
    cosine: Float[np.ndarray, " k"]

    @staticmethod
    def of(patch: Patch, domain: Domain = WHOLE) -> "FacePixels":
        """Pixels of the face of ``patch`` over its domain."""
        axis = np.linspace(-1.0, 1.0, _MAP_PIXELS)
        chart = np.stack(np.meshgrid(axis, axis), axis=-1)
        inside = np.sum(chart**2, axis=-1) <= 1.0
        if domain.edges:
            inside &= np.abs(domain.within(chart) - chart).max(axis=-1) < _SAME
        jet = patch.jet(chart[inside])
        directions = to_sphere(chart[inside])
        area = np.full(inside.shape, np.nan)
        area[inside] = jet.area_element * (axis[1] - axis[0]) ** 2
        return FacePixels(axis, area, directions, np.sum(jet.normal * directions, axis=1))

    def map_um(self, change: Surface) -> Float[np.ndarray, "m m"]:
        """A radial change along the normal (um), [Y, X], NaN outside the rim."""
        return self.over_face(1e3 * self.cosine * change.radius(self.directions))

    @property
    def inside(self) -> Bool[np.ndarray, "m m"]:
        """True at the pixels of the face."""
        return np.isfinite(self.area_mm2)

    def over_face(self, values: Float[np.ndarray, " k"]) -> Float[np.ndarray, "m m"]:
        """A map of ``values`` at the pixels of the face, NaN outside the rim."""
        pixels = np.full(self.area_mm2.shape, np.nan)
        pixels[self.inside] = values
        return pixels

    def extent_um(self, change: Surface) -> Extent:
        """Largest absolute value and rms over the area of a radial change, along the normal (um)."""
        return area_extent(self.map_um(change), self.area_mm2)


@dataclass(frozen=True)
class NominalFace:
    """A face of a lens: its surface, the patch that stands for it, where it lies, and the pixels of its maps.

    ``zone_um``: full width of the tolerance zone of its form; ``places``: tolerances of its place, either way, by their
    fields in the spec; none of a face against which others are placed.
    """

    name: str
    surface: Surface
    patch: Patch
    domain: Domain
    pixels: FacePixels
    zone_um: float | None
    places: Mapping[str, float]

    @staticmethod
    def of(lens: Lens, side: str) -> "NominalFace":
        """The face ``side`` of ``lens``."""
        patch = fit_patch(lens.surfaces[side])
        domain = domain_of(lens, side)
        amounts = {name: lens.spec.part_tolerances.amount(side, name) for name in PLACEMENT}
        return NominalFace(
            name=side,
            surface=lens.surfaces[side],
            patch=patch,
            domain=domain,
            pixels=FacePixels.of(patch, domain),
            zone_um=lens.spec.manufacture.form_tolerance_um,
            places={name: amount for name, amount in amounts.items() if amount > 0.0},
        )
