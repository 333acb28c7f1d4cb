"""The ``[source]`` of a spec: an emitting area or a ray set; lengths in mm, powers in W or lm."""

from typing import Annotated, Literal

from pydantic import Field

from lensforge.pictures.picture import Luminance
from lensforge.spec.emission import CosineIntensity, IntensitySpec
from lensforge.spec.emitter import EmitterSection, FluxSection
from lensforge.spec.ray_source import RayfileSource, RayfilesSource, RaySource
from lensforge.spec.section import Coordinate, FilePath, Millimetres, MillimetresOrZero


class SquareSource(EmitterSection):
    """A square Lambertian emitter, centred on the axis in the plane z = 0 and emitting towards +z unless placed."""

    kind: Literal["square"] = "square"
    side_mm: MillimetresOrZero
    """Side of the square; 0 for a point source."""

    @property
    def description(self) -> str:
        """The source in a few words."""
        return f"{self.side_mm:g} mm square Lambertian source" if self.side_mm else "point source"


class _PlanarSource(EmitterSection):
    """An emitting area, in the plane z = 0 unless placed, the same intensity profile at each of its points."""

    intensity: IntensitySpec = Field(default_factory=CosineIntensity)
    """Intensity by angle; by default Lambertian."""


class RectangleSource(_PlanarSource):
    """A uniform rectangle, centred on the axis."""

    kind: Literal["rectangle"] = "rectangle"
    width_mm: Millimetres
    """Width along x."""
    height_mm: Millimetres
    """Height along y."""

    @property
    def description(self) -> str:
        """The source in a few words."""
        return f"{self.width_mm:g} mm × {self.height_mm:g} mm source"


class DiscSource(_PlanarSource):
    """A uniform disc, centred on the axis."""

    kind: Literal["disc"] = "disc"
    diameter_mm: Millimetres
    """Diameter."""

    @property
    def description(self) -> str:
        """The source in a few words."""
        return f"{self.diameter_mm:g} mm disc source"


class Chip(FluxSection):
    """A uniform rectangle with its centre at (x, y), of 1 W unless its flux is given.

    With ``source.flux_w`` or ``source.flux_lm`` only the ratio of the chips' fluxes counts.
    """

    x_mm: Coordinate
    """Centre along x."""
    y_mm: Coordinate
    """Centre along y."""
    width_mm: Millimetres
    """Width along x."""
    height_mm: Millimetres
    """Height along y."""


class ChipsSource(_PlanarSource):
    """Several chips, each with its position, size and flux; ``flux_w``, ``flux_lm``: of all of them together."""

    kind: Literal["chips"] = "chips"
    chips: Annotated[tuple[Chip, ...], Field(min_length=1, max_length=10_000)]
    """The chips."""

    @property
    def description(self) -> str:
        """The source in a few words."""
        return f"source of {len(self.chips)} chips"


class ChipArraySource(_PlanarSource):
    """Equal chips in rows and columns, centred on the axis."""

    kind: Literal["chip_array"] = "chip_array"
    columns: Annotated[int, Field(ge=1, le=100)]
    """Chips along x."""
    rows: Annotated[int, Field(ge=1, le=100)]
    """Chips along y."""
    width_mm: Millimetres
    """Width of a chip."""
    height_mm: Millimetres
    """Height of a chip."""
    pitch_mm: tuple[Millimetres, Millimetres]
    """Distance of neighbouring centres, in x and y."""

    @property
    def description(self) -> str:
        """The source in a few words."""
        return f"source of {self.columns} × {self.rows} chips"


class LuminanceSource(_PlanarSource):
    """A picture of the lit source, centred on the axis: a pixel's flux follows its light."""

    kind: Literal["luminance"] = "luminance"
    file: FilePath
    """PNG, TIFF, JPEG or BMP file."""
    width_mm: Millimetres
    """Width of the picture."""
    luminance: Luminance = "as_stored"
    """Light that its values stand for, as in a target's picture."""

    @property
    def description(self) -> str:
        """The source in a few words."""
        return f"source of the luminance picture {self.file.name}"


class RadianceSource(EmitterSection):
    """Radiance by position and direction, from a NumPy archive (docs/rayfiles.md); a given flux replaces its own."""

    kind: Literal["radiance"] = "radiance"
    file: FilePath
    """NumPy archive (docs/rayfiles.md)."""

    @property
    def description(self) -> str:
        """The source in a few words."""
        return f"source of the radiance table {self.file.name}"


SourceSpec = Annotated[
    SquareSource
    | RayfileSource
    | RayfilesSource
    | RectangleSource
    | DiscSource
    | ChipsSource
    | ChipArraySource
    | LuminanceSource
    | RadianceSource
    | RaySource,
    Field(discriminator="kind"),
]
