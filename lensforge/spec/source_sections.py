"""The ``[source]`` of a spec: an emitting area, ray files, or given rays; lengths in mm, powers in W or lm."""

from collections.abc import Mapping, Sequence
from itertools import product
from math import hypot
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from lensforge.optics.image import Luminance
from lensforge.public import public
from lensforge.spec.emitter_section import (
    NOTHING_LIT,
    CosineIntensity,
    EmitterSection,
    FluxSection,
    IntensitySpec,
    SpectrumSpec,
)
from lensforge.spec.spec_section import (
    Coordinate,
    FilePath,
    Millimetres,
    MillimetresOrZero,
    Numbers,
    RelativeWeight,
    Section,
    ShortName,
    check,
    fault_of,
    numbers_of,
)


@public
class SquareSource(EmitterSection):
    """A square Lambertian emitter, centred on the axis in the plane z = 0 and emitting towards +z unless placed."""

    in_a_word: ClassVar[tuple[str, ...]] = ("side_mm",)

    kind: Literal["square"] = "square"
    side_mm: MillimetresOrZero = Field(description="Side of the square; 0 for a point source.")

    @property
    def extent_mm(self) -> float:
        """Half of the diagonal."""
        return float(self.side_mm / 2.0**0.5)

    @property
    def description(self) -> str:
        """The source in a few words."""
        return f"{self.side_mm:g} mm square Lambertian source" if self.side_mm else "point source"


Scale = Annotated[float, Field(ge=1e-9, le=1e9)]  # from a file in nm or km to mm, with room to spare


Model = Literal["rays", "radiance", "auto"]


@public
class Placement(EmitterSection):
    """Placement of a ray set in lens coordinates: its own fields in their order, then the fields of every source."""

    origin: Literal["file", "virtual_focus"] | tuple[Coordinate, Coordinate, Coordinate] = Field(
        default="file",
        description="Point that is put at the lens origin: the file's own origin, its virtual focus, or a point "
        "(mm) of the file.",
    )
    scale: Scale = Field(default=1.0, description="Factor of all lengths.")
    axis: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = Field(
        default="+z", description="Direction in the file that becomes the lens axis +z."
    )
    mirror: Literal["none", "x", "y"] = Field(default="none", description='Mirror image: "x" maps x to -x.')
    model: Model = Field(
        default="rays",
        description="Rays of the design: those of the set, or as many as wanted by a radiance fitted to them, or "
        "what suits better.",
    )


@public
class RayfileSource(Placement):
    """Ray file of a vendor."""

    phrase: ClassVar[str] = "ray file {0.file.name}"

    kind: Literal["rayfile"] = "rayfile"
    file: FilePath = Field(description="Ray file: TM-25, IES, Zemax, LightTools, SPEOS and others.")
    model: Model = Field(
        default="auto",
        description="Rays of the design: those of the file, or as many as wanted by a radiance fitted to them, or "
        "what is better.",
    )


@public
class RayfilePart(FluxSection):
    """One of several ray files: its flux, else the flux of the file.

    With ``source.flux_w`` or ``source.flux_lm`` only the ratio counts.
    """

    file: FilePath = Field(description="Ray file.")
    spectrum: SpectrumSpec | None = Field(default=None, description="Spectrum in place of the file's own.")


@public
class RayfilesSource(Placement):
    """Several ray files in one coordinate system as one source, such as the blue and yellow light of a white LED."""

    kind: Literal["rayfiles"] = "rayfiles"
    files: Annotated[tuple[RayfilePart, ...], Field(min_length=1, max_length=100)] = Field(
        description="The ray files, in one coordinate system."
    )
    model: Model = Field(
        default="auto",
        description="Rays of the design: those of the files, or as many as wanted by a radiance fitted to them, "
        "or what is better.",
    )

    @property
    def description(self) -> str:
        """The source in a few words."""
        return f"ray files {', '.join(part.file.name for part in self.files)}"


@public
class PlanarSource(EmitterSection):
    """An emitting area, in the plane z = 0 unless placed, the same intensity profile at each of its points."""

    intensity: IntensitySpec = Field(
        default_factory=CosineIntensity, description="Intensity by angle; by default Lambertian."
    )


@public
class RectangleSource(PlanarSource):
    """A uniform rectangle, centred on the axis."""

    phrase: ClassVar[str] = "{0.width_mm:g} mm × {0.height_mm:g} mm source"
    in_a_word: ClassVar[tuple[str, ...]] = ("width_mm", "height_mm")

    kind: Literal["rectangle"] = "rectangle"
    width_mm: Millimetres = Field(description="Width along x.")
    height_mm: Millimetres = Field(description="Height along y.")

    @property
    def extent_mm(self) -> float:
        """Half of the diagonal."""
        return 0.5 * hypot(self.width_mm, self.height_mm)


@public
class DiscSource(PlanarSource):
    """A uniform disc, centred on the axis."""

    phrase: ClassVar[str] = "{0.diameter_mm:g} mm disc source"
    in_a_word: ClassVar[tuple[str, ...]] = ("diameter_mm",)

    kind: Literal["disc"] = "disc"
    diameter_mm: Millimetres = Field(description="Diameter.")

    @property
    def extent_mm(self) -> float:
        """Half of the diameter."""
        return 0.5 * self.diameter_mm


@public
class Chip(FluxSection):
    """A uniform rectangle with its centre at (x, y), of 1 W unless its flux is given.

    With ``source.flux_w`` or ``source.flux_lm`` only the ratio of the chips' fluxes counts.
    """

    x_mm: Coordinate = Field(description="Centre along x.")
    y_mm: Coordinate = Field(description="Centre along y.")
    width_mm: Millimetres = Field(description="Width along x.")
    height_mm: Millimetres = Field(description="Height along y.")
    spectrum: SpectrumSpec | None = Field(
        default=None, description="Spectrum of this chip, in place of the spectrum of `source`: its colour."
    )


def _lit(shares: Sequence[float], chips: Sequence[Chip]) -> list[tuple[Chip, float]]:
    """The chips that give light, and the share of its flux that each gives."""
    if len(shares) != len(chips):
        raise ValueError(f"dimming: {len(shares)} numbers, must be {len(chips)}: one for each chip")
    lit = [(chip, share) for chip, share in zip(chips, shares, strict=True) if share > 0.0]
    if not lit:
        raise ValueError(NOTHING_LIT)
    return lit


@public
class ChipsSource(PlanarSource):
    """Several chips, each with its position, size and flux; ``flux_w``, ``flux_lm``: of all of them together."""

    kind: Literal["chips"] = "chips"
    chips: Annotated[tuple[Chip, ...], Field(min_length=1, max_length=10_000)] = Field(description="The chips.")

    @property
    def description(self) -> str:
        """The source in a few words."""
        return f"source of {len(self.chips)} chip{'s' if len(self.chips) > 1 else ''}"

    @property
    def extent_mm(self) -> float:
        """Distance of the farthest corner of a chip."""
        return max(hypot(abs(c.x_mm) + 0.5 * c.width_mm, abs(c.y_mm) + 0.5 * c.height_mm) for c in self.chips)

    def at_wavelength(self, wavelength_nm: float) -> Self:
        """The source with all of its light at one wavelength."""
        return super().at_wavelength(wavelength_nm).changed(chips=[chip.changed(spectrum=None) for chip in self.chips])

    def dimmed(self, shares: Sequence[float]) -> "ChipsSource":
        """The source whose chips give these ``shares`` of their flux; those that give none are left out.

        Raises ``ValueError`` unless there is a share for each chip and one above 0, and where fluxes that count by
        their ratio are not all in one unit.
        """
        lit = _lit(shares, self.chips)
        chips = [chip.changed(**(chip.fluxes_times(share) or {"flux_w": share})) for chip, share in lit]
        total = self._share_of(shares) if self.flux_w is not None or self.flux_lm is not None else 1.0
        return self.changed(chips=chips, **self.fluxes_times(total))

    def mirrored(self, axis: Literal["x", "y"]) -> Self:
        """The source where the mirror that maps ``axis`` to minus itself puts it, its chips from the left upwards."""
        place = f"{axis}_mm"
        chips = [chip.changed(**{place: -getattr(chip, place)}) for chip in self.chips]
        return super().mirrored(axis).changed(chips=sorted(chips, key=lambda chip: (chip.y_mm, chip.x_mm)))

    def _share_of(self, shares: Sequence[float]) -> float:
        """Share of the whole flux that these ``shares`` of each chip are."""
        for name in FluxSection.model_fields:
            fluxes = [getattr(chip, name) for chip in self.chips]
            if all(flux is not None for flux in fluxes):
                return sum(share * flux for share, flux in zip(shares, fluxes, strict=True)) / sum(fluxes)
        if any(chip.fluxes_times(1.0) for chip in self.chips):
            raise ValueError("dimming: the flux of some chips is not stated in one unit; give each its flux_lm")
        return sum(shares) / len(shares)

    @property
    def spectra(self) -> tuple[SpectrumSpec | None, ...]:
        """Spectrum of each chip, its own or that of all; empty if none has one of its own."""
        spectra = [chip.spectrum for chip in self.chips]
        return tuple(spectrum or self.spectrum for spectrum in spectra) if any(spectra) else ()


@public
class ChipArraySource(PlanarSource):
    """Equal chips in rows and columns, centred on the axis."""

    phrase: ClassVar[str] = "source of {0.columns} × {0.rows} chips"

    kind: Literal["chip_array"] = "chip_array"
    columns: Annotated[int, Field(ge=1, le=100)] = Field(description="Chips along x.")
    rows: Annotated[int, Field(ge=1, le=100)] = Field(description="Chips along y.")
    width_mm: Millimetres = Field(description="Width of a chip.")
    height_mm: Millimetres = Field(description="Height of a chip.")
    pitch_mm: tuple[Millimetres, Millimetres] = Field(description="Distance of neighbouring centres, in x and y.")

    @property
    def extent_mm(self) -> float:
        """Half of the diagonal of the array."""
        across, up = self.pitch_mm
        return 0.5 * hypot((self.columns - 1) * across + self.width_mm, (self.rows - 1) * up + self.height_mm)

    def dimmed(self, shares: Sequence[float]) -> ChipsSource:
        """The source whose chips give these ``shares`` of their flux, row by row from the corner at -x, -y."""
        across, up = self.pitch_mm
        size = {"width_mm": self.width_mm, "height_mm": self.height_mm}
        places = product(range(self.rows), range(self.columns))
        flux_w = 1.0 / (self.columns * self.rows)
        chips = [
            Chip(
                x_mm=across * (column - 0.5 * (self.columns - 1)),
                y_mm=up * (row - 0.5 * (self.rows - 1)),
                flux_w=flux_w,
                **size,
            )
            for row, column in places
        ]
        kept = self.model_fields_set & ChipsSource.model_fields.keys() - {"kind"}
        return ChipsSource(chips=chips, **{name: getattr(self, name) for name in kept}).dimmed(shares)


@public
class LuminanceSource(PlanarSource):
    """A picture of the lit source, centred on the axis: a pixel's flux follows its light."""

    phrase: ClassVar[str] = "source of the luminance picture {0.file.name}"

    kind: Literal["luminance"] = "luminance"
    file: FilePath = Field(description="PNG, TIFF, JPEG or BMP file.")
    width_mm: Millimetres = Field(description="Width of the picture.")
    luminance: Luminance = Field(
        default="as_stored", description="Light that its values stand for, as in a target's picture."
    )


@public
class RadianceSource(EmitterSection):
    """Radiance by position and direction, from a NumPy archive (docs/sources.md); a given flux replaces its own."""

    phrase: ClassVar[str] = "source of the radiance table {0.file.name}"

    kind: Literal["radiance"] = "radiance"
    file: FilePath = Field(description="NumPy archive (docs/sources.md).")


@public
class RaySource(Placement):
    """Ray set given as arrays, for example from another program."""

    positional: ClassVar[str] = "rays"

    kind: Literal["rays"] = "rays"
    positions_mm: Annotated[Float[np.ndarray, "n 3"], Numbers(2, 3)] = Field(description="Start points (x, y, z).")
    directions: Annotated[Float[np.ndarray, "n 3"], Numbers(2, 3)] = Field(
        description="Directions; they need not have length 1."
    )
    ray_flux: Annotated[Float[np.ndarray, " n"], Numbers(1)] | None = Field(
        default=None,
        description="Flux of each ray in W, or relative where `flux_w` or `flux_lm` says how much all of them "
        "carry; without it all rays have the same.",
    )
    wavelengths_nm: Annotated[Float[np.ndarray, " n"], Numbers(1)] | None = Field(
        default=None,
        description="Wavelength of each ray, used where the lens material is dispersive, for colour, and for the "
        "luminous efficacy.",
    )

    if TYPE_CHECKING:  # the arguments of the class; the fields themselves are validated as everywhere

        def __init__(self, rays: ArrayLike | None = None, /, **fields: Any) -> None: ...

    @model_validator(mode="before")
    @classmethod
    def _one_row_for_each_ray(cls, content: Any) -> Any:
        """Split ``rays``, an array (n, 7) of x, y, z (mm), the direction's three components, and flux, into columns."""
        if not isinstance(content, Mapping) or "rays" not in content:
            return content
        with fault_of("rays"):
            rows = numbers_of(content["rays"])
        if rows.ndim != 2 or rows.shape[1] not in (6, 7):
            raise ValueError(f"rays: shape {rows.shape}, must be (n, 7): x, y, z (mm), direction (3), flux; or (n, 6)")
        columns = {"positions_mm": rows[:, :3], "directions": rows[:, 3:6]}
        if rows.shape[1] == 7:
            columns["ray_flux"] = rows[:, 6]
        twice = [name for name in columns if content.get(name) is not None]
        if twice:
            raise ValueError(f"{twice[0]}: rays of {rows.shape[1]} columns hold it already; give one of the two")
        return {key: value for key, value in content.items() if key != "rays"} | columns

    @check
    def _as_many_of_each(self) -> None:
        count = len(self.positions_mm)
        for name in ("directions", "ray_flux", "wavelengths_nm"):
            array = getattr(self, name)
            if array is not None and len(array) != count:
                raise ValueError(f"{name}: {len(array)} rows, positions_mm has {count}; one for each ray")
        if not self.directions.any(axis=1).all():
            raise ValueError("directions: one of them is (0, 0, 0); leave that ray out")
        if self.ray_flux is not None and not (self.ray_flux.min() >= 0.0 and self.ray_flux.any()):
            raise ValueError("ray_flux: must be 0 or above, and not 0 for all rays")
        if self.ray_flux is None and self.flux_w is None and self.flux_lm is None:
            raise ValueError("flux_w or flux_lm: of all rays, is needed where ray_flux is not given")

    @property
    def description(self) -> str:
        """The source in a few words."""
        return f"{len(self.positions_mm)} given rays"


RaySetSource = RayfileSource | RayfilesSource | RaySource


@public
class NamedSource(Section):
    """One of the LEDs that a lens is for."""

    name: ShortName = Field(description="Name of the LED, in tables, pictures and folders.")
    share: RelativeWeight = Field(default=1.0, description="Weight of its light in the mean over all, relative.")
    source: EmitterSection = Field(description="Where its light starts, how much, and in which directions.")
