"""Base of the fixed surfaces of a spec: the surface, and its shape as figures."""

from functools import lru_cache

from lensforge.spec.section import Section
from lensforge.surfaces.shape import SurfaceShape
from lensforge.surfaces.surface import Surface


class FixedFace(Section):
    """A surface that the search does not change."""

    @property
    def surface(self) -> Surface:
        """The surface. Raises :class:`InputError` where it is not star-shaped about the origin."""
        raise NotImplementedError

    @property
    def title(self) -> str:
        """Words for it."""
        return str(self.kind).replace("_", " ")  # type: ignore[attr-defined]  # of each kind

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line for each matter that a user should know of before the search."""
        return ()

    @property
    def shape(self) -> SurfaceShape:
        """Its shape over the hemisphere."""
        return _shape_of(self)

    @property
    def apex_mm(self) -> float:
        """Height at which it meets the axis."""
        return float(self.shape.radii_mm[0, 0])

    def resolved(self) -> "FixedFace":
        """The same face without a file. Raises :class:`InputError` for a file that does not hold it."""
        return self


@lru_cache(maxsize=8)
def _shape_of(face: FixedFace) -> SurfaceShape:
    return SurfaceShape(face.surface)
