"""The ``[[scene]]`` of a spec: opaque bodies in the light behind the lens, such as a bezel, a tube or a wall.

A kind of body is a class that extends :class:`HousingSection`: it registers itself. Its shape is a function of
``scene.housing_mesh.mesh_of`` for that class.
"""

from collections.abc import Sequence
from math import asin, atan2, degrees
from typing import Annotated, Literal, Self

from pydantic import Field

from lensforge.optics.pose import Pose
from lensforge.public import public
from lensforge.results.registered_kinds import OfSeveralKinds
from lensforge.spec.emitter_section import Degrees, Turn
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.lens_section import LensShape
from lensforge.spec.spec_files import alike
from lensforge.spec.spec_section import Coordinate, FilePath, Millimetres, MillimetresOrZero, Section, check

MOST_BODIES = 32


@public
class HousingSection(OfSeveralKinds, Section):
    """Fields of every opaque body in the light behind the lens. It is black: light that meets it is lost there.

    It stands in the coordinates of the lens, or of all lamps, as receivers do; those behind it are in its shadow. The
    search knows it. No body may reach into the room of the lens.
    """

    kind: str
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")] = Field(
        description="Name, by which the light that is lost there is stated."
    )
    centre_mm: tuple[Coordinate, Coordinate, Coordinate] = Field(
        default=(0.0, 0.0, 0.0), description="Place of its origin."
    )
    tilt_deg: tuple[Degrees, Degrees] = Field(
        default=(0.0, 0.0), description="Tilt of its axis from +z: about x, then about y."
    )
    rotate_z_deg: Turn = Field(default=0.0, description="Turn about its own axis, before the tilt.")
    patch_mm: Millimetres | None = Field(
        default=None,
        description="Width of the patches by which the light on its surface is measured; by default it is not.",
    )

    @property
    def pose(self) -> Pose:
        """Place of the body."""
        return Pose.of_tilts(self.centre_mm, self.tilt_deg, self.rotate_z_deg)

    def posed(self, pose: Pose) -> Self:
        """The body in another pose."""
        x, y, z = pose.axis
        tilt_deg = degrees(asin(max(-1.0, min(1.0, -y)))), degrees(atan2(x, z))
        (along_x, along_y, _), *_ = pose.seen_from(Pose.of_tilts(pose.origin_mm, tilt_deg)).axes
        turn_deg = degrees(atan2(along_y, along_x))
        return self.changed(centre_mm=pose.origin_mm, tilt_deg=tilt_deg, rotate_z_deg=turn_deg)


@public
class HousingBox(HousingSection):
    """A box about its origin, such as a wall."""

    kind: Literal["box"] = "box"
    size_mm: tuple[Millimetres, Millimetres, Millimetres] = Field(description="Its sides along x, y and z.")


@public
class HousingCylinder(HousingSection):
    """A cylinder along its z axis about its origin; with a bore it is a tube, or a round bezel."""

    kind: Literal["cylinder"] = "cylinder"
    radius_mm: Millimetres = Field(description="Radius.")
    bore_radius_mm: MillimetresOrZero = Field(default=0.0, description="Radius of its bore, 0 for none.")
    length_mm: Millimetres = Field(description="Length along z.")

    @check
    def _bore_lies_within(self) -> None:
        if self.bore_radius_mm >= self.radius_mm:
            raise ValueError(
                f"bore_radius_mm = {self.bore_radius_mm:g}: must be less than radius_mm = {self.radius_mm:g}"
            )


@public
class HousingFile(HousingSection):
    """Closed bodies of a STEP, STL or 3MF file, in its coordinates."""

    kind: Literal["file"] = "file"
    file: FilePath = Field(description="STEP, STL or 3MF; STL and 3MF in mm.")


def require_scene(bodies: Sequence[HousingSection], lens: LensShape, lamps: Lamps) -> None:
    """Raise ``ValueError`` for bodies of one name, and for scenes whose shadows are not modelled."""
    if not bodies:
        return
    if (duplicate := alike(body.name for body in bodies)) is not None:
        raise ValueError(f"scene: {duplicate}; give each its own")
    if lens.cover_glass is not None:
        raise ValueError(
            "scene: bodies beside a lens.cover_glass are not modelled, as light would meet them on both of its sides; "
            "leave out the glass, or the bodies"
        )
    if lamps.period_mm is not None:
        raise ValueError(
            "scene: an endless lattice of lamps would need endless bodies; give lamps of kind grid, or no bodies"
        )
