"""The ``[lens.cover_glass]`` of a spec: a plane-parallel plate between the lens and the receivers."""

from typing import Annotated

from pydantic import Field

from lensforge.optics.media import CoverGlass
from lensforge.spec.coating import CoatingSection
from lensforge.spec.section import Millimetres, Section


class CoverGlassSection(Section):
    """A plate across the axis, as wide as the light, in what surrounds the lens.

    What its faces reflect goes back and is followed no further.
    """

    refractive_index: Annotated[float, Field(ge=1.0, le=4.0)]
    """Index of the plate at all wavelengths."""
    thickness_mm: Millimetres
    """Thickness of the plate."""
    distance_mm: Millimetres
    """Height of its near face above z = 0, beyond the whole lens."""
    absorption_per_mm: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """Absorption of the plate: light loses exp(-absorption times path) (Beer and Lambert)."""
    coating: CoatingSection | None = None
    """Coating of both faces, its ``layers`` counted from outside the glass."""

    @property
    def glass(self) -> CoverGlass:
        """The plate as rays meet it."""
        coating = None if self.coating is None else self.coating.coating(self.refractive_index)
        return CoverGlass(self.refractive_index, self.thickness_mm, self.distance_mm, self.absorption_per_mm, coating)
