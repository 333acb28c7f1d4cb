"""The media that a ray passes: what fills the cavity, the body of the lens, what surrounds it, and a cover glass."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CoverGlass:
    """A plane-parallel plate across the axis, as wide as the light, its near face at z = ``distance_mm``.

    What surrounds the lens lies on both sides of it. ``absorption_per_mm``: by the law of Beer and Lambert.
    """

    refractive_index: float
    thickness_mm: float
    distance_mm: float
    absorption_per_mm: float = 0.0


@dataclass(frozen=True)
class Media:
    """Refractive index of the body, and its absorption (1/mm) by the law of Beer and Lambert.

    Both for rays without their own. ``cavity_index`` and ``outside_index`` hold for all rays: 1 is air.
    """

    refractive_index: float
    absorption_per_mm: float = 0.0
    cavity_index: float = 1.0
    outside_index: float = 1.0
    cover_glass: CoverGlass | None = None

    @property
    def largest_turning_power(self) -> float:
        """Larger step of the index of the two faces: a facet of slope s turns light by about s times it."""
        return max(abs(self.refractive_index - self.cavity_index), abs(self.refractive_index - self.outside_index))

    @property
    def etendue_factor(self) -> float:
        """Étendue (mm^2 sr) that light takes outside of that which it has in the cavity: n^2 times it is conserved."""
        return (self.cavity_index / self.outside_index) ** 2
