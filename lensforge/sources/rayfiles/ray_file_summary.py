"""Records about a ray file: its header alone, a summary of its rays with plots, and the result of a conversion.

The plots show start points from the front and from the side, directions, and intensity.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float
from pydantic import PrivateAttr

from lensforge.errors import InputError
from lensforge.results import Count, NotNegative, Number, Point, Record, Share, StageResult, Text
from lensforge.results.files import replacing
from lensforge.results.validation import shortened
from lensforge.sources.rayfiles.ray_file import FluxUnit, HeaderValue, RayFile, as_float64, no_usable_ray, usable_chunks
from lensforge.sources.rayfiles.ray_file_bytes import HUGE
from lensforge.sources.source_summary import RaysDropped

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Panel = Literal["front", "side", "directions", "intensity"]
_PIXELS = 160
_COSINES = 64  # pixels across the unit disc of directions
_RINGS = 180  # of 1 degree each
_QUANTILES = (0.002, 0.998)  # of the start points: few rays start outside, and would shrink the rest
_SAMPLE = 100_000  # rays that choose the frame
_LEAST_FRAME_MM = 1e-3
_LEAST_FRAME = 1e-9  # of its distance from the origin: smaller pixels would be no wider than rounding there
_SUFFIXES = (".png", ".svg", ".pdf")


@dataclass
class Histograms:
    """Flux by start point (front: x and y; side: x and z), by direction cosine, and by angle from +z.

    :meth:`of` a file the flux is absolute, in the file's unit.
    """

    low: Float[np.ndarray, " 3"]
    high: Float[np.ndarray, " 3"]
    front: Float[np.ndarray, "p p"] = field(default_factory=lambda: np.zeros((_PIXELS, _PIXELS)))
    side: Float[np.ndarray, "p p"] = field(default_factory=lambda: np.zeros((_PIXELS, _PIXELS)))
    cosines: Float[np.ndarray, "c c"] = field(default_factory=lambda: np.zeros((_COSINES, _COSINES)))
    rings: Float[np.ndarray, " r"] = field(default_factory=lambda: np.zeros(_RINGS))

    @classmethod
    def of(cls, rayfile: RayFile) -> "Histograms":
        """Bin the rays in one pass, block by block; the frame comes from rays all over the file.

        Raises :class:`InputError` if no ray is usable.
        """
        step = max(len(rayfile) // _SAMPLE, 1)
        starts = np.concatenate([as_float64(block.positions_mm[::step]) for block in rayfile.blocks()])
        starts = starts[(np.abs(starts) < HUGE).all(axis=1)]
        if len(starts) == 0:
            raise no_usable_ray(rayfile, {"not_finite": len(rayfile)})
        low, high = np.quantile(starts, _QUANTILES, axis=0)
        middle = 0.5 * (low + high)
        half = max(0.55 * float((high - low).max()), _LEAST_FRAME_MM, _LEAST_FRAME * float(np.abs(middle).max()))
        histograms = cls(middle - half, middle + half)
        for part in usable_chunks(rayfile):
            histograms.add(part.positions_mm, part.directions, part.flux)
        return histograms.scaled(rayfile.flux_factor(float(histograms.rings.sum())))

    def add(
        self,
        positions: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        flux: Float[np.ndarray, " n"],
    ) -> None:
        """Bin ``n`` rays into all four histograms."""
        frame = list(zip(self.low, self.high, strict=True))
        self.front += _binned(positions[:, 0], positions[:, 1], frame[:2], _PIXELS, flux)
        self.side += _binned(positions[:, 0], positions[:, 2], frame[::2], _PIXELS, flux)
        forward = directions[:, 2] > 0.0
        unit_disc = [(-1.0, 1.0), (-1.0, 1.0)]
        self.cosines += _binned(directions[forward, 0], directions[forward, 1], unit_disc, _COSINES, flux[forward])
        gamma = np.rad2deg(np.arccos(np.clip(directions[:, 2], -1.0, 1.0)))
        self.rings += np.histogram(gamma, _RINGS, (0.0, 180.0), weights=flux)[0]

    def scaled(self, factor: float) -> "Histograms":
        """Multiply all fluxes by ``factor``."""
        images = (self.front, self.side, self.cosines, self.rings)
        return Histograms(self.low, self.high, *(factor * image for image in images))

    def intensity(self) -> Float[np.ndarray, " r"]:
        """Flux per steradian of each ring (mean over azimuth)."""
        edges = np.cos(np.deg2rad(np.linspace(0.0, 180.0, _RINGS + 1)))
        return self.rings / (2.0 * np.pi * (edges[:-1] - edges[1:]))


def _binned(
    x: Float[np.ndarray, " n"],
    y: Float[np.ndarray, " n"],
    frame: list[tuple[float, float]],
    pixels: int,
    flux: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "p p"]:
    binned: Float[np.ndarray, "p p"] = np.histogram2d(x, y, pixels, frame, weights=flux)[0]
    return binned


def draw(rayfile: RayFile, path: Path) -> None:
    """Write all four panels to ``path``, a PNG, SVG or PDF file. Raises :class:`InputError` for any other suffix."""
    from matplotlib.figure import Figure

    if Path(path).suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path}: its suffix must be one of {', '.join(_SUFFIXES)}")
    histograms = Histograms.of(rayfile)
    figure = Figure(figsize=(11.0, 9.0), layout="constrained")
    flux = float(histograms.rings.sum())
    title = f"{shortened(Path(rayfile.path).name)}: {len(rayfile):,} rays, {flux:.4g} {rayfile.flux_unit}"
    figure.suptitle(title, parse_math=False)  # a name may hold $, _ and ^
    for place, which in enumerate(get_args(Panel), start=1):
        draw_panel(figure.add_subplot(2, 2, place), histograms, which, rayfile.flux_unit)
    with replacing(Path(path)) as temporary:
        figure.savefig(temporary, dpi=150)


def draw_panel(axes: "Axes", histograms: Histograms, which: Panel, unit: str) -> None:
    """Draw one of the four panels on ``axes``; ``unit`` of the flux."""
    match which:
        case "front":
            _draw_starts(axes, histograms, "y", histograms.front, 1)
        case "side":
            _draw_starts(axes, histograms, "z", histograms.side, 2)
        case "directions":
            _draw_cosines(axes, histograms.cosines)
        case "intensity":
            _draw_intensity(axes, histograms.intensity(), float(histograms.rings.sum()), unit)


def _draw_starts(axes: "Axes", of: Histograms, name: str, image: np.ndarray, axis: int) -> None:
    frame = (of.low[0], of.high[0], of.low[axis], of.high[axis])
    _show(axes, image, frame)
    axes.set(title=f"where rays start, x and {name}", xlabel="x (mm)", ylabel=f"{name} (mm)")


def _draw_cosines(axes: "Axes", image: np.ndarray) -> None:
    _show(axes, image, (-1.0, 1.0, -1.0, 1.0))
    axes.set(title="forward directions: flux per area of the unit disc", xlabel="kx", ylabel="ky")


def _draw_intensity(axes: "Axes", intensity: Float[np.ndarray, " r"], flux: float, unit: str) -> None:
    gamma = np.arange(_RINGS) + 0.5
    axes.plot(gamma, intensity, color="#c0392b", linewidth=1.8, label="rays")
    lambertian = np.maximum(np.cos(np.deg2rad(gamma)), 0.0) * flux / np.pi
    axes.plot(gamma, lambertian, color="0.6", linewidth=1.0, linestyle="--", label="Lambertian of the same flux")
    axes.set(title="intensity", xlabel="angle from +z (°)", ylabel=f"{unit}/sr", xlim=(0, 180), ylim=(0, None))
    axes.set_xticks(range(0, 181, 30))
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)


def _show(axes: "Axes", image: np.ndarray, frame: tuple[float, float, float, float]) -> None:
    axes.imshow(image.T, origin="lower", extent=frame, cmap="inferno", interpolation="nearest")
    axes.set_aspect("equal")


class FileUnits(Record):
    """Units of the summary; ``length_in_file_mm``: the file's own unit of length in mm."""

    length: Literal["mm"] = "mm"
    length_in_file_mm: Number
    flux: FluxUnit


class HeaderFlux(Record):
    """Totals that a header states; ``unit`` is that of the rays."""

    unit: FluxUnit
    header_w: Number | None
    header_lm: Number | None


class FileFlux(HeaderFlux):
    """Flux of the source by header and by rays, in ``unit``; ``total_from``: the one that ``total`` is."""

    total: Number
    total_from: Literal["header", "rays"]
    ray_sum: Number
    ray_sum_over_header: Number | None
    backward_share: Share


class WavelengthRange(Record):
    """Wavelengths (nm); ``mean``: by flux, None where the shares of several spectral tables are unknown."""

    min: Number
    max: Number
    mean: Number | None = None


class Box(Record):
    """Two corners of a box (mm)."""

    min: Point
    max: Point


class RayFileHeader(Record):
    """Header of a ray file alone. ``header``: its fields by the names of its format."""

    format: Text
    title: Text | None
    rays: Count
    units: FileUnits
    flux: HeaderFlux
    wavelengths_nm: WavelengthRange | None
    header: dict[Text, HeaderValue]
    warnings: tuple[Text, ...]


class RayFileSummary(StageResult):
    """Summary of a ray file: header, counts, and statistics of the usable rays; lengths in mm, wavelengths in nm.

    ``effective_rays``: number of rays of equal flux that would have the same noise.
    """

    stage: ClassVar[str] = "rays"
    made_from: ClassVar[tuple[str, ...]] = ()

    format: Text
    title: Text | None
    rays: Count
    units: FileUnits
    rays_used: Count
    rays_dropped: RaysDropped
    effective_rays: NotNegative
    flux: FileFlux
    bounding_box_mm: Box
    virtual_focus_mm: Point | None
    mean_direction: Point
    wavelengths_nm: WavelengthRange | None
    header: dict[Text, HeaderValue]
    warnings: tuple[Text, ...]
    _rayfile: RayFile | None = PrivateAttr(None)

    def holding(self, rayfile: RayFile) -> "RayFileSummary":
        """Attach the rays for :meth:`plot`; they are neither compared nor saved."""
        self._rayfile = rayfile
        return self

    def plot(self, axes: "Axes | None" = None, *, which: Panel = "front") -> "Axes":
        """Plot start points from the front (x, y) or the side (x, z), the forward directions, or the intensity.

        Raises :class:`InputError` for an unknown panel, and for a summary that was read from a file: it has no rays.
        """
        from lensforge.results.plots import new_axes, require_choice

        require_choice("which", which, get_args(Panel))
        if self._rayfile is None:
            raise InputError("this summary was read back and holds no rays; read the ray file itself again")
        axes = new_axes(axes)
        draw_panel(axes, Histograms.of(self._rayfile), which, self.units.flux)
        return axes

    def _repr_html_(self) -> str:
        """Show start points and the summary as a table in a notebook."""
        return Record._repr_html_(self) if self._rayfile is None else super()._repr_html_()


class Conversion(Record):
    """Conversion of a ray file: formats, size, and the data that the new format could not hold."""

    from_format: Text
    to_format: Text
    rays: Count
    bytes: Count
    lost: tuple[Text, ...]
    warnings: tuple[Text, ...]
