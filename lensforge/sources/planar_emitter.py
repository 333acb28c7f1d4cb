"""Planar emitters: an area in the plane z = 0 times an intensity profile."""

from dataclasses import dataclass
from functools import singledispatch

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError, remedy
from lensforge.optics.image_reading import read_light
from lensforge.seeds import sobol
from lensforge.sources.emitting_area import Area, Disc, LuminanceImage, Rectangles
from lensforge.sources.intensity import CosinePower, TabulatedIntensity
from lensforge.sources.light_files import read_photometric
from lensforge.sources.photometric.photometric_file import far_field_warnings, turned_over
from lensforge.sources.ray_bundle import RayBundle, aimed
from lensforge.sources.ray_colours import ChipColours
from lensforge.sources.source_flux import chip_fluxes, emitter_flux
from lensforge.spec.emitter_section import CosineIntensity, IntensitySpec, TableIntensity
from lensforge.spec.source_sections import (
    ChipArraySource,
    ChipsSource,
    DiscSource,
    LuminanceSource,
    PlanarSource,
    RectangleSource,
)
from lensforge.surfaces.mirror_group import shared_symmetry


@dataclass(frozen=True)
class PlanarEmitter:
    """An area whose points all emit with the intensity ``profile``; total flux ``flux_w``, rays of equal flux."""

    area: Area
    profile: CosinePower | TabulatedIntensity
    flux_w: float = 1.0
    ray_count: int | None = None
    warnings: tuple[str, ...] = ()  # on the file of the profile
    colours: ChipColours | None = None  # of rectangles with spectra of their own

    @property
    def symmetry(self) -> str:
        """Largest mirror group that area and profile share."""
        return shared_symmetry([self.area.symmetry, self.profile.symmetry])

    @property
    def is_round(self) -> bool:
        """True for a disc whose light is equal in all azimuths."""
        profile = self.profile
        return isinstance(self.area, Disc) and (isinstance(profile, CosinePower) or len(profile.c_deg) == 1)

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw ``count`` rays of equal flux by quasi-Monte-Carlo points in four dimensions."""
        points = sobol(count, 4, seed)
        origins = np.zeros((count, 3))
        origins[:, :2] = self.area.place(points[:, :2])
        rays = RayBundle(origins, self.profile.aim(points[:, 2:]), np.full(count, self.flux_w / count))
        if self.colours is None or not isinstance(self.area, Rectangles):
            return rays
        return self.colours.given(rays, self.area.numbers(points[:, 0]), seed)

    def radiances(self, count: int, seed: int) -> Float[np.ndarray, " n"]:
        """Radiance (W/(mm^2 sr)) of each ray of ``sample(count, seed)``: emittance times intensity over its cosine."""
        rays = self.sample(count, seed)
        intensity = self.profile.intensity(rays.directions) / np.abs(rays.directions[:, 2])
        return np.asarray(self.flux_w * self.area.density(rays.origins[:, :2]) * intensity)

    def towards(self, targets: Float[np.ndarray, "n 3"], seed: int) -> RayBundle:
        """The rays of ``sample(len(targets), seed)``, each turned to its target (mm); their flux is W/sr there."""
        return aimed(self.sample(len(targets), seed), targets, self.profile.intensity)

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Polygon (mm) around the area."""
        corners = self.area.corners()
        return np.column_stack([corners, np.zeros(len(corners))])


def planar_emitter(spec: PlanarSource, *, disperses: bool = False, coloured: bool = False) -> PlanarEmitter:
    """Build the emitter that ``spec`` describes, in the plane z = 0.

    Rays of chips with spectra of their own carry wavelengths where the lens ``disperses``, else where it is asked for
    X, Y and Z per W. Raises :class:`InputError` for a file that cannot be used.
    """
    profile, warnings = _profile(spec.intensity)
    colours = ChipColours.of(spec.spectra, disperses=disperses, coloured=coloured)
    return PlanarEmitter(area_of(spec), profile, emitter_flux(spec).flux_w, warnings=warnings, colours=colours)


@singledispatch
def area_of(spec: PlanarSource) -> Area:
    """The emitting area of ``spec``. A kind of source in a plane registers its function here."""
    raise NotImplementedError(f"no emitting area of kind {spec.kind}: register a function with area_of")


area_of.register(DiscSource, lambda spec: Disc(0.5 * spec.diameter_mm))
area_of.register(RectangleSource, lambda spec: _grid(1, 1, (spec.width_mm, spec.height_mm), (1.0, 1.0)))
area_of.register(
    ChipArraySource, lambda spec: _grid(spec.columns, spec.rows, (spec.width_mm, spec.height_mm), spec.pitch_mm)
)


@area_of.register
def _(spec: LuminanceSource) -> Area:
    with remedy("correct source.file"):
        values = read_light(spec.file, spec.luminance, missing="give an image file")
        if not values.max() > 0.0:
            raise InputError(f"{spec.file}: pixels must not be all dark")
    return LuminanceImage.of(values, spec.width_mm)


@area_of.register
def _(spec: ChipsSource) -> Area:
    flux = np.array([chip.flux_w for chip in chip_fluxes(spec)])
    centres = np.array([[chip.x_mm, chip.y_mm] for chip in spec.chips])
    sides = np.array([[chip.width_mm, chip.height_mm] for chip in spec.chips])
    kinds = list(dict.fromkeys(spec.spectra))
    numbers = np.array([kinds.index(spectrum) for spectrum in spec.spectra], dtype=np.int64)
    return Rectangles(centres, sides, flux / flux.sum(), numbers)


def _grid(columns: int, rows: int, side_mm: tuple[float, float], pitch_mm: tuple[float, float]) -> Rectangles:
    x = (np.arange(columns) - 0.5 * (columns - 1)) * pitch_mm[0]
    y = (np.arange(rows) - 0.5 * (rows - 1)) * pitch_mm[1]
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return Rectangles(centres, np.tile(side_mm, (len(centres), 1)), np.full(len(centres), 1.0 / len(centres)))


def _profile(spec: IntensitySpec) -> tuple[CosinePower | TabulatedIntensity, tuple[str, ...]]:
    if isinstance(spec, CosineIntensity):
        return CosinePower(spec.power), ()
    if isinstance(spec, TableIntensity):
        return TabulatedIntensity(np.zeros(1), np.array(spec.gamma_deg), np.array([spec.intensity])), ()
    with remedy("correct source.intensity.file"):
        file = read_photometric(spec.file)
    warnings = tuple(f"{spec.file.name}: {warning}" for warning in far_field_warnings(file))
    return TabulatedIntensity.of(turned_over(file.intensity)), warnings
