"""The ``[source]`` of a spec: what emits, in its several kinds; every length in mm, powers in W."""

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from pydantic import Field, PositiveFloat, model_validator

from lensforge.spec.arrays import Numbers, real_numbers
from lensforge.spec.section import Coordinate, FilePath, Millimetres, MillimetresOrZero, Section
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

    kind: Literal["square"] = "square"
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

    kind: Literal["rayfile"] = "rayfile"
    file: FilePath

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"ray file {self.file.name}"


class RayfilePart(Section):
    """One of several ray files: its power (W), or that of the file; with ``source.flux_w`` only the ratio counts.

    ``spectrum`` takes the place of the file's own.
    """

    file: FilePath
    flux_w: PositiveFloat | None = None
    spectrum: Spectrum | None = None


class RayfilesSource(Placement):
    """Several ray files in one coordinate system as one source, such as the blue and yellow light of a white LED."""

    kind: Literal["rayfiles"] = "rayfiles"
    files: Annotated[tuple[RayfilePart, ...], Field(min_length=1)]

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"ray files {', '.join(part.file.name for part in self.files)}"


class RaySource(Placement):
    """Rays given as arrays, such as those of another program: start points (mm), directions, and the flux of each.

    Directions need not have length 1. ``ray_flux``: W, or relative where ``flux_w`` says how much all of them carry;
    without it all rays are alike. ``wavelengths_nm``: counts where the lens is of a dispersive material.
    """

    positional: ClassVar[str] = "rays"

    kind: Literal["rays"] = "rays"
    positions_mm: Annotated[Float[np.ndarray, "n 3"], Numbers(2, 3)]
    directions: Annotated[Float[np.ndarray, "n 3"], Numbers(2, 3)]
    ray_flux: Annotated[Float[np.ndarray, " n"], Numbers(1)] | None = None
    wavelengths_nm: Annotated[Float[np.ndarray, " n"], Numbers(1)] | None = None

    if TYPE_CHECKING:  # what the class takes; the fields themselves are validated as everywhere

        def __init__(
            self,
            rays: ArrayLike | None = None,
            /,
            *,
            positions_mm: ArrayLike | None = None,
            directions: ArrayLike | None = None,
            ray_flux: ArrayLike | None = None,
            wavelengths_nm: ArrayLike | None = None,
            origin: Literal["file", "virtual_focus"] | tuple[float, float, float] = "file",
            scale: float = 1.0,
            axis: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = "+z",
            mirror: Literal["none", "x", "y"] = "none",
            rotate_z_deg: float = 0.0,
            flux_w: float | None = None,
            luminous_efficacy_lm_per_w: float | None = None,
            spectrum: Spectrum | None = None,
        ) -> None: ...

    @model_validator(mode="before")
    @classmethod
    def _one_row_for_each_ray(cls, content: Any) -> Any:
        """``rays``: an array (n, 7) of x, y, z, the direction's three components, and flux."""
        if not isinstance(content, Mapping) or "rays" not in content:
            return content
        try:
            rows = real_numbers(content["rays"])
        except ValueError as error:
            raise ValueError(f"rays: {error}") from None
        if rows.ndim != 2 or rows.shape[1] not in (6, 7):
            raise ValueError(f"rays: shape {rows.shape}, must be (n, 7): x, y, z (mm), direction (3), flux; or (n, 6)")
        columns = {"positions_mm": rows[:, :3], "directions": rows[:, 3:6]}
        if rows.shape[1] == 7:
            columns["ray_flux"] = rows[:, 6]
        twice = [name for name in columns if content.get(name) is not None]
        if twice:
            raise ValueError(f"{twice[0]}: rays of {rows.shape[1]} columns hold it already; give one of the two")
        return {key: value for key, value in content.items() if key != "rays"} | columns

    @model_validator(mode="after")
    def _as_many_of_each(self) -> "RaySource":
        count = len(self.positions_mm)
        for name in ("directions", "ray_flux", "wavelengths_nm"):
            array = getattr(self, name)
            if array is not None and len(array) != count:
                raise ValueError(f"{name}: {len(array)} rows, positions_mm has {count}; one for each ray")
        if not np.linalg.norm(self.directions, axis=1).all():
            raise ValueError("directions: one of them is (0, 0, 0); leave that ray out")
        if self.ray_flux is not None and not (self.ray_flux.min() >= 0.0 and self.ray_flux.sum() > 0.0):
            raise ValueError("ray_flux: must be 0 or above, and not 0 for all rays")
        if self.ray_flux is None and self.flux_w is None:
            raise ValueError("flux_w: the power (W) of all rays is needed where ray_flux is not given")
        return self

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"{len(self.positions_mm)} given rays"


class CosineIntensity(Section):
    """Intensity in proportion to ``cos(gamma)^power``; power 1 is Lambertian."""

    kind: Literal["cosine"] = "cosine"
    power: Annotated[float, Field(ge=0.0, le=1e4)] = 1.0


class TableIntensity(Section):
    """Intensity (W/sr or relative) at angles ``gamma_deg`` from the axis, linear in between, none beyond them."""

    kind: Literal["table"] = "table"
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

    kind: Literal["photometric"] = "photometric"
    file: FilePath


Intensity = Annotated[CosineIntensity | TableIntensity | PhotometricIntensity, Field(discriminator="kind")]


class _PlanarSource(_Emitter):
    """An emitting area in the plane z = 0, the same intensity profile at each of its points."""

    intensity: Intensity = Field(default_factory=CosineIntensity)


class RectangleSource(_PlanarSource):
    """A uniform rectangle, centred on the axis."""

    kind: Literal["rectangle"] = "rectangle"
    width_mm: Millimetres
    height_mm: Millimetres
    flux_w: PositiveFloat = 1.0

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"{self.width_mm:g} mm × {self.height_mm:g} mm source"


class DiscSource(_PlanarSource):
    """A uniform disc, centred on the axis."""

    kind: Literal["disc"] = "disc"
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

    kind: Literal["chips"] = "chips"
    chips: Annotated[tuple[Chip, ...], Field(min_length=1, max_length=10_000)]
    flux_w: PositiveFloat | None = None

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"source of {len(self.chips)} chips"


class ChipArraySource(_PlanarSource):
    """Equal chips in rows and columns, centred on the axis; ``pitch_mm`` from centre to centre, in x and y."""

    kind: Literal["chip_array"] = "chip_array"
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

    kind: Literal["luminance"] = "luminance"
    file: FilePath
    width_mm: Millimetres
    flux_w: PositiveFloat = 1.0

    @property
    def title(self) -> str:
        """What it is, in a few words."""
        return f"source of the luminance picture {self.file.name}"


class RadianceSource(_Emitter):
    """Radiance by place and direction, from a NumPy archive (docs/rayfiles.md); ``flux_w``: if not the table's own."""

    kind: Literal["radiance"] = "radiance"
    file: FilePath
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
    | RadianceSource
    | RaySource,
    Field(discriminator="kind"),
]
