"""Records about a ray file: its header alone, a summary of its rays with plots, and the result of a conversion.

The plots show start points from the front and from the side, directions, and intensity.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float
from pydantic import PrivateAttr

from lensforge.errors import InputError, shortened
from lensforge.public import public
from lensforge.results import Count, NotNegative, Number, Point, Record, Share, StageResult, Text
from lensforge.results.arguments import require_choice
from lensforge.results.figure import Figure
from lensforge.results.files import replacing
from lensforge.results.plots import Axes, new_axes
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.rayfiles.ray_file import FluxUnit, HeaderValue, RayFile, no_usable_ray
from lensforge.sources.rayfiles.ray_file_rows import HUGE, as_float64
from lensforge.sources.source_summary import RaysDropped
from lensforge.sources.stored_rays import usable_blocks

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
        for block, _ in usable_blocks(rayfile):
            histograms.add(block)
        factor = rayfile.flux_factor(float(histograms.rings.sum()))
        for image in (histograms.front, histograms.side, histograms.cosines, histograms.rings):
            image *= factor
        return histograms

    def add(self, rays: RayBundle) -> None:
        """Bin more rays into all four histograms."""
        positions = rays.origins
        directions = rays.directions
        flux = rays.flux
        frame = list(zip(self.low, self.high, strict=True))
        forward = directions[:, 2] > 0.0
        for image, x, y, part, ends in (
            (self.front, positions[:, 0], positions[:, 1], flux, frame[:2]),
            (self.side, positions[:, 0], positions[:, 2], flux, frame[::2]),
            (self.cosines, directions[forward, 0], directions[forward, 1], flux[forward], [(-1.0, 1.0)] * 2),
        ):
            image += np.histogram2d(x, y, len(image), ends, weights=part)[0]
        gamma = np.rad2deg(np.arccos(np.clip(directions[:, 2], -1.0, 1.0)))
        self.rings += np.histogram(gamma, _RINGS, (0.0, 180.0), weights=flux)[0]

    def intensity(self) -> Float[np.ndarray, " r"]:
        """Flux per steradian of each ring (mean over azimuth)."""
        edges = np.cos(np.deg2rad(np.linspace(0.0, 180.0, _RINGS + 1)))
        return self.rings / (2.0 * np.pi * (edges[:-1] - edges[1:]))


def draw(rayfile: RayFile, path: Path) -> None:
    """Write all four panels to ``path``, a PNG, SVG or PDF file. Raises :class:`InputError` for any other suffix."""
    import matplotlib.style
    from matplotlib.figure import Figure as Drawing

    if Path(path).suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path}: its suffix must be one of {', '.join(_SUFFIXES)}")
    histograms = Histograms.of(rayfile)
    flux = float(histograms.rings.sum())
    title = f"{shortened(Path(rayfile.path).name)}: {len(rayfile):,} rays, {flux:.4g} {rayfile.flux_unit}"
    with matplotlib.style.context("default"), replacing(Path(path)) as temporary:  # whatever a matplotlibrc says
        figure = Drawing(figsize=(11.0, 9.0), layout="constrained")
        figure.suptitle(title, parse_math=False)  # a name may hold $, _ and ^
        for place, panel in enumerate(get_args(Panel), start=1):
            draw_panel(figure.add_subplot(2, 2, place), histograms, panel, rayfile.flux_unit)
        figure.savefig(temporary, dpi=150)


def draw_panel(axes: "Axes", histograms: Histograms, panel: Panel, unit: str) -> None:
    """Draw one of the four panels on ``axes``; ``unit`` of the flux."""
    if panel == "intensity":
        _draw_intensity(axes, histograms.intensity(), float(histograms.rings.sum()), unit)
        return
    (x, y, z) = histograms.low
    (far_x, far_y, far_z) = histograms.high
    image, frame, title, xlabel, ylabel = {
        "front": (histograms.front, (x, far_x, y, far_y), "where rays start, x and y", "x (mm)", "y (mm)"),
        "side": (histograms.side, (x, far_x, z, far_z), "where rays start, x and z", "x (mm)", "z (mm)"),
        "directions": (
            histograms.cosines,
            (-1.0, 1.0) * 2,
            "forward directions: flux per area of the unit disc",
            "kx",
            "ky",
        ),
    }[panel]
    axes.imshow(image.T, origin="lower", extent=frame, cmap="inferno", interpolation="nearest")
    axes.set(title=title, xlabel=xlabel, ylabel=ylabel, aspect="equal")


def _draw_intensity(axes: "Axes", intensity: Float[np.ndarray, " r"], flux: float, unit: str) -> None:
    gamma = np.arange(_RINGS) + 0.5
    axes.plot(gamma, intensity, color="#c0392b", linewidth=1.8, label="rays")
    lambertian = np.maximum(np.cos(np.deg2rad(gamma)), 0.0) * flux / np.pi
    axes.plot(gamma, lambertian, color="0.6", linewidth=1.0, linestyle="--", label="Lambertian of the same flux")
    axes.set(title="intensity", xlabel="angle from +z (°)", ylabel=f"{unit}/sr", xlim=(0, 180), ylim=(0, None))
    axes.set_xticks(range(0, 181, 30))
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)


class FileFlux(Record):
    """Flux of the source by header and by rays, in ``unit``; ``total_from``: which of them ``total`` is."""

    unit: FluxUnit
    header_w: Annotated[Number | None, Figure("flux by the header")]
    header_lm: Annotated[Number | None, Figure("flux by the header")]
    total: Annotated[Number | None, Figure("flux of the source", unit="{unit}")] = None
    total_from: Annotated[Literal["header", "rays"] | None, Figure("which is taken from")] = None
    ray_sum: Annotated[Number | None, Figure("sum of the rays", unit="{unit}")] = None
    backward_share: Annotated[Share | None, Figure("share towards −z")] = None


class WavelengthRange(Record):
    """Wavelengths (nm); ``mean``: by flux, None if the shares of several spectral tables are unknown."""

    min: Annotated[Number, Figure("shortest wavelength")]
    max: Annotated[Number, Figure("longest wavelength")]
    mean: Annotated[Number | None, Figure("mean wavelength")] = None


class Box(Record):
    """Two corners of a box (mm)."""

    min: Annotated[Point, Figure("start points from")]
    max: Annotated[Point, Figure("start points to")]


@public
class RayFileSummary(StageResult):
    """Summary of a ray file. What only the rays can say is None if the header alone was read.

    ``format``: of the file. ``title``: by its header. ``rays``: in the file. ``rays_used``: that carry flux.
    ``rays_dropped``: the others, by cause. ``effective_rays``: number of rays of equal flux that would have the same
    noise. ``flux``: in W and lm, and what states it. ``bounding_box_mm``: around the start points, least and largest
    corner. ``virtual_focus_mm``: point nearest to all rays. ``mean_direction``: of the flux. ``wavelengths_nm``: their
    range. ``header``: its fields by the names of its format. ``model``: the radiance that was fitted to it, in words.
    """

    stage: ClassVar[str] = "rays"
    made_from: ClassVar[tuple[str, ...]] = ()

    format: Text
    title: Text | None
    rays: Annotated[Count, Figure("rays in the file")]
    rays_used: Count | None = None
    rays_dropped: Annotated[
        RaysDropped | None,
        Figure("left out: not finite", of="not_finite"),
        Figure("left out: no direction", of="zero_direction"),
        Figure("left out: no flux", of="no_flux"),
    ] = None
    effective_rays: Annotated[NotNegative | None, Figure("rays of equal flux, as noisy")] = None
    flux: FileFlux
    bounding_box_mm: Box | None = None
    virtual_focus_mm: Point | None = None
    mean_direction: Point | None = None
    wavelengths_nm: WavelengthRange | None
    header: dict[Text, HeaderValue]
    warnings: tuple[Text, ...]
    model: Text | None = None
    _rayfile: RayFile | None = PrivateAttr(None)

    def plot(self, axes: "Axes | None" = None, *, which: Panel = "front") -> "Axes":
        """Plot start points from the front (x, y) or the side (x, z), the forward directions, or the intensity.

        Raises :class:`InputError` for an unknown panel, and for a summary that was read from a file: it has no rays.
        """
        require_choice("which", which, get_args(Panel))
        if self._rayfile is None:
            raise InputError("this summary was read back and holds no rays; read the ray file itself again")
        axes = new_axes(axes)
        draw_panel(axes, Histograms.of(self._rayfile), which, self.flux.unit)
        return axes

    def _repr_html_(self) -> str:
        """Show start points and the summary as a table in a notebook."""
        return Record._repr_html_(self) if self._rayfile is None else super()._repr_html_()
