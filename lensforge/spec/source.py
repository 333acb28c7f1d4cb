"""The ``[source]`` of a spec: what emits, in its several kinds; every length in mm, powers in W."""

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, model_validator

from lensforge.spec.section import Coordinate, Millimetres, MillimetresOrZero, Section
from lensforge.spec.spectrum import Spectrum


class _Emitter(Section):
    """What every source has.

    ``luminous_efficacy_lm_per_w`` of its light: with it, reports speak in lux, without it in W/m^2. ``spectrum``:
    counts where the lens is of a dispersive material; of a ray file it takes the place of the file's own.
    """

    luminous_efficacy_lm_per_w: Annotated[float, Field(gt=0.0, le=683.0)] | None = None
    spectrum: Spectrum | None = None


class SquareSource(_Emitter):
    """A square Lambertian emitter in the plane z = 0, centred on the axis, emitting towards +z."""

    kind: Literal["square"]
    side_mm: MillimetresOrZero
    flux_w: PositiveFloat = 1.0

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"{self.side_mm:g} mm square Lambertian source" if self.side_mm else "point source"


class Placement(_Emitter):
    """How measured rays come to lie in lens coordinates, in the order of the fields.

    ``origin``: the file's own, its virtual focus, or a point (mm) of the file, put at the lens origin. ``scale``:
    factor of all lengths. ``axis``: the direction in the file that becomes the lens axis +z. ``mirror``: ``x`` maps x
    to -x. ``rotate_z_deg``: turn about the lens axis. ``flux_w``: the power (W) of the whole source; without it, that
    of the file.
    """

    origin: Literal["file", "virtual_focus"] | tuple[Coordinate, Coordinate, Coordinate] = "file"
    scale: PositiveFloat = 1.0
    axis: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = "+z"
    mirror: Literal["none", "x", "y"] = "none"
    rotate_z_deg: float = 0.0
    flux_w: PositiveFloat | None = None


class RayfileSource(Placement):
    """A vendor's ray file."""

    kind: Literal["rayfile"]
    file: Path

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"ray file {self.file.name}"


class RayfilePart(Section):
    """One of several ray files: its power (W), or that of the file; with ``source.flux_w`` only the ratio counts.

    ``spectrum`` takes the place of the file's own.
    """

    file: Path
    flux_w: PositiveFloat | None = None
    spectrum: Spectrum | None = None


class RayfilesSource(Placement):
    """Several ray files in one coordinate system as one source, such as the blue and yellow light of a white LED."""

    kind: Literal["rayfiles"]
    files: Annotated[tuple[RayfilePart, ...], Field(min_length=1)]

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"ray files {', '.join(part.file.name for part in self.files)}"


class CosineIntensity(Section):
    """Intensity in proportion to ``cos(gamma)^power``; power 1 is Lambertian."""

    kind: Literal["cosine"] = "cosine"
    power: Annotated[float, Field(ge=0.0, le=1e4)] = 1.0


class TableIntensity(Section):
    """Intensity (W/sr or relative) at angles ``gamma_deg`` from the axis, linear in between, none beyond them."""

    kind: Literal["table"]
    gamma_deg: tuple[Annotated[float, Field(ge=0.0, le=180.0)], ...]
    intensity: tuple[Annotated[float, Field(ge=0.0)], ...]

    @model_validator(mode="after")
    def _is_a_function(self) -> "TableIntensity":
        angles = self.gamma_deg
        if len(angles) < 2 or any(b <= a for a, b in pairwise(angles)):
            raise ValueError("gamma_deg must be two angles or more, each larger than the one before")
        if len(self.intensity) != len(angles) or not any(self.intensity):
            raise ValueError(f"intensity must be {len(angles)} numbers, one for each gamma_deg, not all zero")
        return self


class PhotometricIntensity(Section):
    """The far field in an IES LM-63 or EULUMDAT file; its gamma = 0 is the lens axis, its C = 0 the x axis."""

    kind: Literal["photometric"]
    file: Path


Intensity = Annotated[CosineIntensity | TableIntensity | PhotometricIntensity, Field(discriminator="kind")]


class _PlanarSource(_Emitter):
    """An emitting area in the plane z = 0, the same intensity profile at each of its points."""

    intensity: Intensity = CosineIntensity()


class RectangleSource(_PlanarSource):
    """A uniform rectangle, centred on the axis."""

    kind: Literal["rectangle"]
    width_mm: Millimetres
    height_mm: Millimetres
    flux_w: PositiveFloat = 1.0

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"{self.width_mm:g} mm × {self.height_mm:g} mm source"


class DiscSource(_PlanarSource):
    """A uniform disc, centred on the axis."""

    kind: Literal["disc"]
    diameter_mm: Millimetres
    flux_w: PositiveFloat = 1.0

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"{self.diameter_mm:g} mm disc source"


class Chip(Section):
    """A uniform rectangle with its centre at (x, y); with ``source.flux_w`` only the ratio of powers counts."""

    x_mm: Coordinate
    y_mm: Coordinate
    width_mm: Millimetres
    height_mm: Millimetres
    flux_w: PositiveFloat = 1.0


class ChipsSource(_PlanarSource):
    """Several chips, each where it is and as strong as it is; ``flux_w``: of all of them together."""

    kind: Literal["chips"]
    chips: Annotated[tuple[Chip, ...], Field(min_length=1, max_length=10_000)]
    flux_w: PositiveFloat | None = None

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"source of {len(self.chips)} chips"


class ChipArraySource(_PlanarSource):
    """Equal chips in rows and columns, centred on the axis; ``pitch_mm`` from centre to centre, in x and y."""

    kind: Literal["chip_array"]
    columns: Annotated[int, Field(ge=1, le=100)]
    rows: Annotated[int, Field(ge=1, le=100)]
    width_mm: Millimetres
    height_mm: Millimetres
    pitch_mm: tuple[Millimetres, Millimetres]
    flux_w: PositiveFloat = 1.0

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"source of {self.columns} × {self.rows} chips"


class LuminanceSource(_PlanarSource):
    """A picture of the lit source, ``width_mm`` wide and centred on the axis: each pixel emits as its value says."""

    kind: Literal["luminance"]
    file: Path
    width_mm: Millimetres
    flux_w: PositiveFloat = 1.0

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"source of the luminance picture {self.file.name}"


class RadianceSource(_Emitter):
    """Radiance by place and direction, from a NumPy archive (docs/rayfiles.md); ``flux_w``: if not the table's own."""

    kind: Literal["radiance"]
    file: Path
    flux_w: PositiveFloat | None = None

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"source of the radiance table {self.file.name}"


Source = Annotated[
    SquareSource
    | RayfileSource
    | RayfilesSource
    | RectangleSource
    | DiscSource
    | ChipsSource
    | ChipArraySource
    | LuminanceSource
    | RadianceSource,
    Field(discriminator="kind"),
]
