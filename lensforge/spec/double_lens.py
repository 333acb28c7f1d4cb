"""The lens of two freeform faces, one within the other, each of which refracts the light: the usual kind."""

from typing import Literal

from lensforge.public import public
from lensforge.spec.lens_section import StartConditions
from lensforge.spec.shell_shape import ShellShape
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.surface import Surface


@public
class LensSection(ShellShape):
    """Double-freeform lens: an inner face towards the source, an outer one towards the target."""

    title = "double-freeform lens"
    kind: Literal["double"] = "double"

    def start_faces(self, conditions: StartConditions) -> dict[str, Surface]:
        """Spheres about the origin."""
        fixed = self.fixed
        return {name: fixed[name] or sphere(radius_mm) for name, radius_mm in self.start_mm.items()}
