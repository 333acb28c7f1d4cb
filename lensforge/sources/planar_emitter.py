"""Planar emitters: an area in the plane z = 0, or a luminance image on it, times an intensity profile.

Each pixel of a luminance image emits in proportion to its value.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError, remedy
from lensforge.optics.image import Luminance
from lensforge.optics.image_reading import read_light
from lensforge.sources.emitting_area import Area, Disc, Rectangles, sobol
from lensforge.sources.intensity import CosinePower, IntensityProfile, TabulatedIntensity
from lensforge.sources.inverse_cdf import choose
from lensforge.sources.photometric import read_photometric
from lensforge.sources.photometric.photometric_file import far_field_warnings, turned_over
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.source_flux import chip_fluxes, emitter_flux
from lensforge.spec.emitter_section import CosineIntensity, IntensitySpec, TableIntensity
from lensforge.spec.source_sections import ChipArraySource, ChipsSource, DiscSource, LuminanceSource, RectangleSource
from lensforge.surfaces.mirror_group import NAMES, contains, largest_symmetry


@dataclass(frozen=True, eq=False)
class LuminanceImage:
    """Image centred on the axis, row 0 at its top (+y); each pixel uniform, ``values`` relative luminance."""

    values: Float[np.ndarray, "h w"]
    pitch_mm: float

    @classmethod
    def read(cls, path: Path, width_mm: float, luminance: Luminance = "as_stored") -> "LuminanceImage":
        """Read an image file, colours and values by ``luminance``. Raises :class:`InputError` if it cannot be used."""
        values = read_light(path, luminance, missing="give an image file")
        if not values.max() > 0.0:
            raise InputError(f"{path}: pixels must not be all dark")
        return cls(values / values.sum(), width_mm / values.shape[1])

    @property
    def symmetry(self) -> str:
        """Largest mirror group found by comparing the image with its mirror images, bit by bit."""
        return largest_symmetry(lambda mirror: np.array_equal(self._mirrored(mirror), self.values))

    def _mirrored(self, mirror: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "a b"]:
        upright = self.values[::-1].T  # first index x, second y
        turned = upright.T if mirror[0, 0] == 0.0 else upright
        signs = mirror.sum(axis=1)
        return turned[:: int(signs[0]), :: int(signs[1])].T[::-1]

    def place(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Choose the row by the first number, the column by the second given the row; uniform inside the pixel."""
        height, width = self.values.shape
        row, down = choose(np.cumsum(self.values.sum(axis=1)), points[:, 0])
        cumulative = np.cumsum(self.values)  # flat: a row's own distribution is a stretch of it
        first = np.where(row > 0, cumulative[row * width - 1], 0.0)
        last = cumulative[row * width + width - 1]
        flat, across = choose(cumulative, (first + points[:, 1] * (last - first)) / cumulative[-1])
        column = np.clip(flat - row * width, 0, width - 1)
        x = (column + across) - 0.5 * width
        y = 0.5 * height - (row + down)
        return self.pitch_mm * np.stack([x, y], axis=1)

    def density(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Share of the flux per mm^2 in the pixel in which each point (mm) lies."""
        height, width = self.values.shape
        column = np.clip(np.floor(points[:, 0] / self.pitch_mm + 0.5 * width), 0, width - 1).astype(int)
        row = np.clip(np.floor(0.5 * height - points[:, 1] / self.pitch_mm), 0, height - 1).astype(int)
        found: Float[np.ndarray, " n"] = self.values[row, column] / self.pitch_mm**2
        return found

    def corners(self) -> Float[np.ndarray, "4 2"]:
        """Rectangle (mm) around the pixels that emit."""
        height, width = self.values.shape
        rows, columns = np.nonzero(self.values)
        left, right = columns.min() - 0.5 * width, columns.max() + 1 - 0.5 * width
        top, bottom = 0.5 * height - rows.min(), 0.5 * height - rows.max() - 1
        return self.pitch_mm * np.array([[left, bottom], [right, bottom], [right, top], [left, top]])


PlanarSource = RectangleSource | DiscSource | ChipsSource | ChipArraySource | LuminanceSource


@dataclass(frozen=True)
class PlanarEmitter:
    """Area each point of which emits with the intensity ``profile``; total flux ``flux_w``, rays of equal flux."""

    area: Area
    profile: IntensityProfile
    flux_w: float = 1.0
    ray_count: int | None = None
    warnings: tuple[str, ...] = ()  # on the file of the profile

    @property
    def symmetry(self) -> str:
        """Largest mirror group of both area and profile."""
        shared = (self.area.symmetry, self.profile.symmetry)
        return next(name for name in reversed(NAMES) if all(contains(larger, name) for larger in shared))

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw ``count`` rays of equal flux by quasi-Monte-Carlo points in four dimensions."""
        points = sobol(count, 4, seed)
        origins = np.zeros((count, 3))
        origins[:, :2] = self.area.place(points[:, :2])
        return RayBundle(origins, self.profile.aim(points[:, 2:]), np.full(count, self.flux_w / count))

    def radiances(self, count: int, seed: int) -> Float[np.ndarray, " n"]:
        """Radiance (W/(mm^2 sr)) of each ray of ``sample(count, seed)``: emittance times intensity over its cosine."""
        rays = self.sample(count, seed)
        intensity = self.profile.intensity(rays.directions) / np.abs(rays.directions[:, 2])
        found: Float[np.ndarray, " n"] = self.flux_w * self.area.density(rays.origins[:, :2]) * intensity
        return found

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Polygon (mm) around the area."""
        corners = self.area.corners()
        return np.column_stack([corners, np.zeros(len(corners))])


def planar_emitter(spec: PlanarSource) -> PlanarEmitter:
    """Build the emitter that ``spec`` describes, in the plane z = 0.

    Raises :class:`InputError` for a file that cannot be used.
    """
    profile, warnings = _profile(spec.intensity)
    match spec:
        case RectangleSource():
            area: Area = _grid(1, 1, (spec.width_mm, spec.height_mm), (1.0, 1.0))
        case ChipArraySource():
            area = _grid(spec.columns, spec.rows, (spec.width_mm, spec.height_mm), spec.pitch_mm)
        case DiscSource():
            area = Disc(0.5 * spec.diameter_mm)
        case LuminanceSource():
            with remedy("correct source.file"):
                area = LuminanceImage.read(spec.file, spec.width_mm, spec.luminance)
        case ChipsSource():
            area = _chips(spec)
    return PlanarEmitter(area, profile, emitter_flux(spec).flux_w, warnings=warnings)


def _chips(spec: ChipsSource) -> Rectangles:
    flux = np.array([chip.flux_w for chip in chip_fluxes(spec)])
    centres = np.array([[chip.x_mm, chip.y_mm] for chip in spec.chips])
    sides = np.array([[chip.width_mm, chip.height_mm] for chip in spec.chips])
    return Rectangles(centres, sides, flux / flux.sum())


def _grid(columns: int, rows: int, side_mm: tuple[float, float], pitch_mm: tuple[float, float]) -> Rectangles:
    x = (np.arange(columns) - 0.5 * (columns - 1)) * pitch_mm[0]
    y = (np.arange(rows) - 0.5 * (rows - 1)) * pitch_mm[1]
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return Rectangles(centres, np.tile(side_mm, (len(centres), 1)), np.full(len(centres), 1.0 / len(centres)))


def _profile(spec: IntensitySpec) -> tuple[IntensityProfile, tuple[str, ...]]:
    """The profile, and warnings on its file."""
    if isinstance(spec, CosineIntensity):
        return CosinePower(spec.power), ()
    if isinstance(spec, TableIntensity):
        return TabulatedIntensity(np.zeros(1), np.array(spec.gamma_deg), np.array([spec.intensity])), ()
    with remedy("correct source.intensity.file"):
        found = read_photometric(spec.file)
    warnings = tuple(f"{spec.file.name}: {warning}" for warning in far_field_warnings(found))
    return turned_over(found.intensity), warnings
