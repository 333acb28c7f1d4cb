"""The media that a ray passes: what fills the cavity, the body of the lens, what surrounds it, and a cover glass.

Each face between them may carry a coating, which replaces Fresnel's reflectance.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class IndexCurve:
    """Refractive index at ``wavelengths_nm`` (rising), linear between them; without them one for all wavelengths."""

    refractive_index: tuple[float, ...]
    wavelengths_nm: tuple[float, ...] = ()

    def at(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Index at each wavelength; beyond the curve that at its end."""
        if not self.wavelengths_nm:
            return np.full(len(wavelengths_nm), self.refractive_index[0])
        found: Float[np.ndarray, " n"] = np.interp(wavelengths_nm, self.wavelengths_nm, self.refractive_index)
        return found


@dataclass(frozen=True)
class ReflectanceTable:
    """Unpolarised reflectance of a coated face by wavelength and by angle in the less dense medium (degrees, from 0).

    Over the cosine of the angle a monotone cubic (Fritsch and Carlson), up to 1 at 90 degrees where the table ends
    before; linear between ``wavelengths_nm`` (rising), or without them one row for all.
    """

    angles_deg: tuple[float, ...]
    reflectance: tuple[tuple[float, ...], ...]
    wavelengths_nm: tuple[float, ...] = ()


@dataclass(frozen=True)
class CoatingLayer:
    """A layer of a coating, that absorbs nothing."""

    index: IndexCurve
    thickness_nm: float


@dataclass(frozen=True)
class LayerStack:
    """Layers of a coated face, the first next to what surrounds the body; they interfere, the body does not.

    ``body``: index of the body by wavelength. All indices are known over ``range_nm``.
    """

    layers: tuple[CoatingLayer, ...]
    body: IndexCurve
    range_nm: tuple[float, float]


Coating = ReflectanceTable | LayerStack


@dataclass(frozen=True)
class CoverGlass:
    """A plane-parallel plate across the axis, as wide as the light, its near face at z = ``distance_mm``.

    What surrounds the lens lies on both sides of it. ``absorption_per_mm``: by the law of Beer and Lambert.
    ``coating``: of both faces.
    """

    refractive_index: float
    thickness_mm: float
    distance_mm: float
    absorption_per_mm: float = 0.0
    coating: Coating | None = None


@dataclass(frozen=True)
class Media:
    """Refractive index of the body, and its absorption (1/mm) by the law of Beer and Lambert.

    Both for rays without their own. ``cavity_index`` and ``outside_index`` hold for all rays: 1 is air.
    ``wavelength_nm``: of rays without their own, where a coating depends on it.
    """

    refractive_index: float
    absorption_per_mm: float = 0.0
    cavity_index: float = 1.0
    outside_index: float = 1.0
    cover_glass: CoverGlass | None = None
    inner_coating: Coating | None = None
    outer_coating: Coating | None = None
    wavelength_nm: float = 587.5618  # the He d line

    @property
    def coated(self) -> bool:
        """True where a face carries a coating, those of the cover glass too."""
        glass = self.cover_glass
        return any((self.inner_coating, self.outer_coating, glass is not None and glass.coating))

    @property
    def largest_turning_power(self) -> float:
        """Larger step of the index of the two faces: a facet of slope s turns light by about s times it."""
        return max(abs(self.refractive_index - self.cavity_index), abs(self.refractive_index - self.outside_index))

    @property
    def etendue_factor(self) -> float:
        """Étendue (mm^2 sr) that light takes outside of that which it has in the cavity: n^2 times it is conserved."""
        return (self.cavity_index / self.outside_index) ** 2
