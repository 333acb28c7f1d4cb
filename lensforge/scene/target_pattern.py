"""Target patterns as relative light on the pixels of a receiver: means over each pixel, of all targets together.

The regions of a receiver in which uniformity counts, and in which light counts as in the target, follow from its
targets.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter, map_coordinates, maximum_filter, minimum_filter

from lensforge.errors import InputError, remedy
from lensforge.kernels.parallel import in_pieces
from lensforge.optics.image_reading import MOST_BYTES
from lensforge.results.files import read_file
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.target_light import MISSING, LightAt, light_of
from lensforge.spec import TargetSection
from lensforge.spec.target_sections import IN_TARGET

_WORTH_SHARING = 2**15  # hits: three milliseconds of work
_OVERSAMPLING = 8  # sub-pixels per side: the area average of a hard edge is right to 1/64 of a pixel
_LEAST_SUBPIXELS = 512  # across the receiver: resolves small patterns
_MOST_SUBPIXELS = 4096  # across the receiver: bounds the memory
_PLACES = 64  # along a side of a region of uniform light, and from the edge of a far field to the horizon
_CANVAS = 1024  # pixels across the far field on which soft edges are drawn: 0.16 degrees on that to 80 degrees
_KEPT_PATTERNS = 16  # a design asks for those of search and evaluation again and again; 48 MB at most each

Targets = tuple[TargetSection, ...]
TargetImage = Float[np.ndarray, "h w"]
Means = Float[np.ndarray, "p q"]


@dataclass(frozen=True)
class DrawnTarget:
    """The targets of a receiver: ``light`` on its pixels [row y, column x], relative, with sum 1.

    ``inside``: sub-pixels of ``fine`` in which they are above a tenth of their largest pixel. ``contains_exactly``:
    the same of places on the chart, where no edge is soft; None if one is.
    """

    light: TargetImage
    fine: PixelGrid
    inside: Bool[np.ndarray, "q r"]
    contains_exactly: Callable[[Float[np.ndarray, "n 2"]], Bool[np.ndarray, " n"]] | None = None

    def contains(self, hits: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """True for hits in the target: exactly, but for a soft edge, which is known to a sub-pixel."""
        grid = self.fine
        is_inside = np.empty(len(hits), dtype=bool)

        def work(part: slice) -> None:
            column, row = np.floor((hits[part] / grid.size + 0.5) * (grid.columns, grid.rows)).T
            within = (column >= 0.0) & (column < grid.columns) & (row >= 0.0) & (row < grid.rows)
            places = row[within].astype(np.intp), column[within].astype(np.intp)
            inside = self.inside[places]
            if self.contains_exactly is not None:
                divided = self._divided[places]
                inside[divided] = self.contains_exactly(hits[part][within][divided])
            within[within] = inside
            is_inside[part] = within

        in_pieces(work, len(hits), worth=_WORTH_SHARING)
        return is_inside

    @property
    def grid(self) -> PixelGrid:
        """Pixels of ``light``."""
        rows, columns = self.light.shape
        return replace(self.fine, columns=columns, rows=rows)

    @cached_property
    def _divided(self) -> Bool[np.ndarray, "q r"]:
        """Sub-pixels that the edge of the target may divide: those beside one that is on the other side of it."""
        return np.asarray(maximum_filter(self.inside, 3) != minimum_filter(self.inside, 3))

    @cached_property
    def coverage(self) -> TargetImage:
        """Share of each pixel's area that is in the target."""
        return _block_means(self.inside.astype(np.float64), self.fine.columns // self.light.shape[1])


def target_light(targets: Targets, receiver: PosedReceiver) -> TargetImage:
    """Mean of the light wanted over each pixel [row y, column x], irradiance or intensity, with sum 1.

    Raises :class:`InputError` when the targets are dark everywhere on the receiver.
    """
    return drawn_target(targets, receiver).light.copy()


def drawn_target(targets: Targets, receiver: PosedReceiver) -> DrawnTarget:
    """The light wanted, and where the target is. Raises :class:`InputError` as :func:`target_light`."""
    return _drawn(targets, receiver, tuple(_content(target) for target in targets), _subpixels(receiver))


def coarser_target(targets: Targets, receiver: PosedReceiver) -> DrawnTarget:
    """The light wanted, on half as many pixels and with sub-pixels twice as wide: it shows what a raster changes."""
    half = replace(receiver, grid=receiver.grid.halved())
    return _drawn(targets, half, tuple(_content(target) for target in targets), _subpixels(receiver))


def _subpixels(receiver: PosedReceiver) -> int:
    """Sub-pixels along a side of each pixel."""
    longest = max(receiver.grid.shape)
    return max(1, min(max(_OVERSAMPLING, _LEAST_SUBPIXELS // longest), _MOST_SUBPIXELS // longest))


def _content(target: TargetSection) -> str:
    """SHA-256 of the file of a target, empty without one: another picture of the same name is another target."""
    file: Path | None = getattr(target, "file", None)
    if file is None:
        return ""
    with remedy("correct target.file"):
        return hashlib.sha256(read_file(file, missing=MISSING, most_bytes=MOST_BYTES)).hexdigest()


@lru_cache(maxsize=_KEPT_PATTERNS)
def _drawn(targets: Targets, receiver: PosedReceiver, contents: tuple[str, ...], times: int) -> DrawnTarget:
    fine = receiver.grid.finer(times)
    wanted = np.zeros(receiver.grid.shape)
    lit = np.zeros(fine.shape)
    scales = []
    for target in targets:
        means, image = _softened(*_drawn_sharp(target, receiver, fine), times)
        # one alone keeps its scale, to the last bit
        scale = target.level / (means.max() or np.inf) if len(targets) > 1 else 1.0
        scales.append(scale)
        wanted += scale * means
        lit += scale * image
    total = float(wanted.sum())
    if not total >= np.finfo(np.float64).tiny:
        raise InputError(
            "target: it is dark everywhere on the receiver; check its size and image, and the size of the receiver; "
            f"where it is narrower than one of {max(receiver.grid.shape)} pixels, raise optimise.pixels and "
            "evaluate.pixels"
        )
    least = IN_TARGET * float(wanted.max())
    soft = any(target.edge > 0.0 and not target.has_own_edge for target in targets)
    exactly = None if soft else partial(_brighter_than, least, receiver, tuple(zip(targets, scales, strict=True)))
    drawn = DrawnTarget(wanted / total, fine, lit > least, exactly)
    if receiver.lamps.period_mm is None:  # of lamps without end the pattern goes on beyond it
        for target in targets:
            _require_uniform_lit(target, receiver, drawn)
    return drawn


def _brighter_than(
    least: float,
    receiver: PosedReceiver,
    scaled_targets: tuple[tuple[TargetSection, float], ...],
    hits: Float[np.ndarray, "n 2"],
) -> Bool[np.ndarray, " n"]:
    """True where the light of targets with sharp edges, each by its scale, is above ``least``."""
    x, y = receiver.target_coordinates(*hits.T)
    light = np.zeros(len(hits))
    for target, scale in scaled_targets:
        light += scale * light_of(target, receiver.grid)(*target.about_centre(x, y))
    return np.asarray((light > least) & (receiver.window.contains(hits) if receiver.is_far else True))


def _require_uniform_lit(target: TargetSection, receiver: PosedReceiver, drawn: DrawnTarget) -> None:
    """Raise :class:`InputError` for a region of uniform light of which a part is dark, or off the receiver."""
    sides = target.pair("uniform")
    if sides is None:
        return
    within = 1.5 * max(drawn.fine.pixel) * (180.0 / np.pi if receiver.is_far else 1.0)  # what sub-pixels know
    along = np.linspace(-0.5, 0.5, _PLACES)
    x, y = (coordinates.ravel() for coordinates in np.meshgrid(*(max(side - within, 0.0) * along for side in sides)))
    places = (x + 1j * y) * np.exp(1j * np.radians(target.rotation_deg)) + complex(*target.centre)
    dark = ~drawn.contains(np.stack(receiver.chart_coordinates(places.real, places.imag), axis=1))
    if dark.any():
        raise InputError(
            f"target: uniform_{target.unit} = {' x '.join(f'{side:g}' for side in sides)} reaches beyond the light: "
            f"{max(1.0, 100.0 * dark.mean()):.0f} % of it is dark; lower it until it lies in the light of the "
            f"{target.description}, or leave it out"
        )


def _require_within(target: TargetSection, light: LightAt, most: float, half_deg: float) -> None:
    """Raise :class:`InputError` for light of a far field beyond its receiver, above half of the ``most`` on that."""
    angles = np.linspace(half_deg, 90.0, _PLACES + 1)[1:, None]
    azimuth = np.linspace(0.0, 2.0 * np.pi, 4 * _PLACES)
    beyond = light(*target.about_centre(angles * np.cos(azimuth), angles * np.sin(azimuth))) > 0.5 * most
    if half_deg < 90.0 and beyond.any():
        farthest = float(angles[beyond.any(axis=1)].max())
        raise InputError(
            f"target: {target.description} goes on beyond its receiver of half_angle_deg = {half_deg:.4g}, up to "
            f"{farthest:.3g} deg; raise half_angle_deg"
        )


def _drawn_sharp(
    target: TargetSection, receiver: PosedReceiver, fine: PixelGrid
) -> tuple[TargetImage, tuple[float, float]]:
    """One target on the sub-pixels, and the soft edge that it still needs, in sub-pixels along rows and columns."""
    edge = 0.0 if target.has_own_edge else target.edge
    if receiver.is_far:
        return _on_far_field(target, receiver, fine, edge), (0.0, 0.0)
    light = light_of(target, receiver.grid)
    pattern = light(*target.about_centre(fine.x()[None, :], fine.y()[:, None]))
    sub_width, sub_height = fine.pixel
    return np.broadcast_to(pattern, fine.shape), (edge / sub_height, edge / sub_width)


def _on_far_field(target: TargetSection, receiver: PosedReceiver, fine: PixelGrid, edge: float) -> TargetImage:
    """Light on the equal-area chart; soft edges are drawn, and blurred, over angles along x and y."""
    x, y = receiver.target_coordinates(*np.meshgrid(fine.x(), fine.y()))
    within = receiver.window.pixels(fine)
    light = light_of(target, receiver.grid)
    sharp = np.where(within, light(*target.about_centre(x, y)), 0.0)
    if not target.outline:  # others fit their receivers by that
        radius = np.array([min(receiver.window.radius, 2.0)])  # that of the whole chart
        _require_within(target, light, float(sharp.max()), receiver.target_coordinates(radius, np.zeros(1))[0].item())
    if edge == 0.0:
        return sharp
    reach = float(np.hypot(x, y)[within].max()) + 4.0 * edge
    canvas = PixelGrid.square(2.0 * reach, _CANVAS)
    drawn = np.broadcast_to(light(*target.about_centre(canvas.x()[None, :], canvas.y()[:, None])), canvas.shape)
    blurred = gaussian_filter(drawn, edge / canvas.pixel[0], mode="constant")
    places = (np.stack([y, x]) / (2.0 * reach) + 0.5) * _CANVAS - 0.5
    return np.where(within, map_coordinates(blurred, places, order=1, mode="constant"), 0.0)


def _softened(image: TargetImage, edge: tuple[float, float], times: int) -> tuple[Means, TargetImage]:
    """``image`` convolved with a Gaussian, dark outside it: means over ``times`` x ``times``, and itself.

    ``edge``: its standard deviations along the rows' and the columns' number.
    """
    blurred = gaussian_filter(image, edge, mode="constant") if max(edge) > 0.0 else image
    return _block_means(blurred, times), blurred


def _block_means(image: TargetImage, times: int) -> Means:
    rows, columns = (size // times for size in image.shape)
    return image.reshape(rows, times, columns, times).mean(axis=(1, 3))


def uniform_region(
    targets: Targets, receiver: PosedReceiver, wider_by_pixels: float = 0.0
) -> Bool[np.ndarray, "h w"] | None:
    """Pixels whose centres lie in the region of uniform light of any of ``targets``; None if none has one."""
    grid = receiver.grid
    region = None
    for target in targets:
        sides = target.pair("uniform")
        if sides is None:
            continue
        x, y = receiver.target_coordinates(*np.meshgrid(grid.x(), grid.y()))
        x, y = target.about_centre(x, y)
        to_degrees = 180.0 / np.pi if receiver.is_far else 1.0
        width, height = (
            side + wider_by_pixels * to_degrees * pixel for side, pixel in zip(sides, grid.pixel, strict=True)
        )
        inside = (np.abs(y) <= height / 2.0) & (np.abs(x) <= width / 2.0)
        region = inside if region is None else region | inside
    return region


def in_target(light: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels in the target: where it is above a tenth of its maximum."""
    return light > IN_TARGET * light.max()
