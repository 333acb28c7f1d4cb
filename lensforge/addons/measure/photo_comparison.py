"""A photograph of the part's light against the simulation, as in the paper's Fig. 7."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import map_coordinates

from lensforge.addons.measure.image_similarity import SimilarityFit, fit_similarity, moved_back, normalised, similarity
from lensforge.addons.measure.measurement_result import Alignment, Evenness, Located, PhotoComparison, Pixel
from lensforge.addons.measure.target_corners import Square, listed, locate, means
from lensforge.errors import InputError
from lensforge.optics.image_reading import read_picture
from lensforge.results import Metric
from lensforge.results.estimates import relative_deviation, uniformity
from lensforge.scene.pixel_grid import PixelGrid

Size = tuple[float, float]  # width, height
_MOST_SAMPLES = 16  # per side of a pixel of the result
_ORDER = "top left, top right, bottom right, bottom left of the simulated picture (y upwards)"
_CLEARLY = 0.5  # another orientation is reported only if its NMSE is at most half
# Order of the corners of an upright picture for each orientation.
_ORIENTATIONS = {
    "rotated by 90 deg anticlockwise": (1, 2, 3, 0),
    "rotated by 180 deg": (2, 3, 0, 1),
    "rotated by 90 deg clockwise": (3, 0, 1, 2),
    "mirrored, left for right": (1, 0, 3, 2),
    "mirrored, top for bottom": (3, 2, 1, 0),
    "mirrored about a diagonal": (0, 3, 2, 1),
    "mirrored about the other diagonal": (2, 1, 0, 3),
}


@dataclass(frozen=True)
class Photograph:
    """Linear light by pixel, any unit, [row, column] with row 0 at the top; full scale of the camera is 1.

    ``clipped``: any colour was at full scale, so that the light may have been brighter. ``orientation``: that of EXIF,
    by which the picture was turned.
    """

    light: Float[np.ndarray, "h w"]
    clipped: Bool[np.ndarray, "h w"]
    orientation: int = 1


def read_photograph(path: Path, gamma: float = 1.0, orientation: int | None = None) -> Photograph:
    """Read a grey or colour image of 8 to 16 bits; its values to the power of ``gamma`` are the light.

    Use 1 for raw images, 2.2 for most processed ones. ``orientation``: instead of the one that the file states, for a
    second photograph of the same camera on the same stand. Raises :class:`InputError`.
    """
    picture = read_picture(path, missing="give the photograph as PNG, TIFF, JPEG or BMP", orientation=orientation)
    if picture.values.dtype not in (np.uint8, np.uint16):
        kind = f"pixels of type {picture.values.dtype}, must be of 8 or 16 bits"
        raise InputError(f"{path}: {kind}; convert it to PNG or TIFF")
    at_full: Bool[np.ndarray, "h w c"] = picture.values >= picture.full_scale
    clipped: Bool[np.ndarray, "h w"] = np.any(at_full, axis=2)
    return Photograph(picture.linear(gamma), clipped, picture.orientation)


def lit_only(on: Photograph, off: Photograph | None) -> Photograph:
    """Subtract ``off``, taken with the LED off and the same exposure, from ``on``."""
    if off is None:
        return on
    if on.light.shape != off.light.shape:
        raise InputError(
            f"off: {off.light.shape[1]} x {off.light.shape[0]} pixels, the photograph with the LED on has "
            f"{on.light.shape[1]} x {on.light.shape[0]}; take both with the same camera settings"
        )
    return Photograph(on.light - off.light, on.clipped, on.orientation)


def rectify(
    picture: Float[np.ndarray, "i j"], corners: Float[np.ndarray, "4 2"], target_mm: Size, grid: PixelGrid
) -> Float[np.ndarray, "h w"]:
    """Average ``picture`` over each pixel of ``grid``, indexed [y, x] with y upwards.

    ``corners``: column and row in the picture, 0 at the centre of the first pixel, of the corners of the centred
    rectangle of width and height ``target_mm``: top left, top right, bottom right, bottom left as the simulation shows
    them. A camera behind the panel sees them mirrored; given in this order, they undo it. Light outside the picture is
    NaN. Raises :class:`InputError` for corners that do not bound a rectangle seen from one side.
    """
    transform = _homography(corners, target_mm)
    samples = _samples(corners, target_mm, grid)
    fine = grid.finer(samples)
    x, y = np.meshgrid(fine.x(), fine.y())
    columns, rows = transform(np.stack([x.ravel(), y.ravel()], axis=1)).T
    values = map_coordinates(picture, [rows, columns], order=1, mode="constant", cval=np.nan)
    return means(values.reshape(fine.shape), samples)


def _homography(corners: Float[np.ndarray, "4 2"], target_mm: Size) -> Any:
    """Homography from mm on the target to column and row: a ``skimage.transform.ProjectiveTransform``."""
    from skimage.transform import ProjectiveTransform

    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    if not (np.isfinite(corners).all() and ((turns > 1.0).all() or (turns < -1.0).all())):
        raise InputError(f"corners {listed(corners)}: they bound no convex quadrilateral; the order is {_ORDER}")
    rectangle = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]]) * target_mm
    return ProjectiveTransform.from_estimate(rectangle, corners)


def _samples(corners: Float[np.ndarray, "4 2"], target_mm: Size, grid: PixelGrid) -> int:
    """Samples along a side of a pixel: at least one for each pixel of the picture."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)  # top, right, bottom, left
    longest = np.array([sides[::2].max(), sides[1::2].max()])
    return int(np.clip(np.ceil((longest / target_mm * grid.pixel).max()), 2, _MOST_SAMPLES))


def require_upright(
    measured: Float[np.ndarray, "h w"], simulated: Float[np.ndarray, "h w"], corners: Float[np.ndarray, "4 2"]
) -> None:
    """Raise :class:`InputError` where ``measured`` is far more similar to ``simulated`` when rotated or mirrored.

    Both are normalised. Either the camera was rotated or stood behind the panel, or the lens itself is wrong. The
    picture alone cannot tell, so the user decides, by giving the corners in that order or in the present one. Turns
    that would lay a long side on a short one are left out.
    """
    upright = similarity(measured, simulated).nmse
    turned = {name: _turned(measured, order) for name, order in _ORIENTATIONS.items()}
    other = {
        name: similarity(image, simulated).nmse for name, image in turned.items() if image.shape == simulated.shape
    }
    best = min(other, key=lambda name: other[name])
    if other[best] < _CLEARLY * upright:
        order = listed(corners[list(_ORIENTATIONS[best])])
        raise InputError(
            f"on: the light is more like the simulation if the picture is {best} (NMSE {other[best]:.2g}, upright "
            f"{upright:.2g}); if the camera saw it so, give corners {order}; if not, give corners {listed(corners)}"
        )


def _turned(image: Float[np.ndarray, "h w"], order: tuple[int, ...]) -> Float[np.ndarray, "i j"]:
    """``image`` ([y, x], y upwards) as rectified by its corners in another ``order``."""
    # Corner ``order[k]`` of the image moves to position k.
    place = np.array([[1, 0], [1, 1], [0, 1], [0, 0]])  # (y, x) of top left, top right, bottom right, bottom left
    taken = place[list(order)]
    if taken[0, 0] == taken[1, 0]:  # along the top, x still runs
        return image[:: 1 if taken[0, 0] else -1, :: 1 if taken[1, 1] else -1]
    turned = image.T
    # Transposed, the new x runs along the old y.
    return turned[:: 1 if taken[0, 1] > taken[3, 1] else -1, :: 1 if taken[1, 0] > taken[0, 0] else -1]


_LEAST_PIXELS = 11  # the window of SSIM
CORNER_PX = 0.2  # scatter of a corner that was found, along each axis; one given by hand is hardly better


@dataclass(frozen=True)
class Shot:
    """Photographs: LED on, LED off, the target's corners (column, row), its side, the camera's gamma.

    Corners of None are found in the photographs; with a side of None they are those of the design's receiver. Raises
    :class:`InputError` for a side or a gamma that is not above 0 and finite.
    """

    on: Path
    off: Path | None
    corners: Float[np.ndarray, "4 2"] | None
    target_mm: float | None = None
    gamma: float = 1.0

    def __post_init__(self) -> None:
        for name, value in (("target_mm", self.target_mm), ("gamma", self.gamma)):
            if value is not None and not 0.0 < value < np.inf:
                raise InputError(f"{name} = {value:g}: must be above 0 and finite")


def compare_photo(
    shot: Shot, *, simulated: Float[np.ndarray, "h w"], grid: PixelGrid, uniform: Bool[np.ndarray, "h w"] | None
) -> PhotoComparison:
    """Compare ``shot`` with the ``simulated`` irradiance ([y, x], any unit) on a plane with the pixels ``grid`` (mm).

    Both images are scaled to a mean of 1. ``uniform``: pixels whose uniformity is compared. Raises
    :class:`InputError` for photographs or corners that cannot be used.
    """
    reference = normalised(simulated)
    picture, located = _picture(shot, grid, reference)
    measured = picture.light
    fit = fit_similarity(measured, reference, grid)
    alike = similarity(measured, reference)
    return PhotoComparison(
        inputs={},
        on=shot.on.name,
        off=shot.off.name if shot.off else None,
        corners=pixels_of(picture.corners),
        corners_located=located,
        target_mm=_target(shot, grid),
        width_mm=grid.width,
        height_mm=grid.height,
        gamma=shot.gamma,
        pixels=max(grid.shape),
        ssim=alike.ssim,
        nmse=alike.nmse,
        alignment=_alignment(fit, _corner_error(picture.corners, _target(shot, grid))),
        aligned=similarity(normalised(moved_back(measured, fit, grid)), reference),
        measured_evenness=_evenness(measured, uniform),
        simulated_evenness=_evenness(reference, uniform),
        clipped=picture.clipped,
        measured=measured,
        simulated=reference,
    )


def _corner_error(corners: Float[np.ndarray, "4 2"], target_mm: Size) -> Float[np.ndarray, "4"]:
    """Standard errors of ln s, rotation (rad) and shifts (mm) by the target's corners: a rectangle fitted."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    width = 0.5 * (sides[0] + sides[2])
    height = 0.5 * (sides[1] + sides[3])
    relative = CORNER_PX / float(np.hypot(width, height))
    return np.array([relative, relative, *(0.5 * CORNER_PX * np.array(target_mm) / (width, height))])


def _alignment(fit: SimilarityFit, by_corners: Float[np.ndarray, "4"]) -> Alignment:
    scale = float(np.exp(fit.parameters[0]))
    errors = np.hypot(fit.errors, by_corners)
    units = np.array([scale, np.degrees(1.0), 1.0, 1.0])
    values = [scale, float(np.degrees(fit.parameters[1])), *map(float, fit.parameters[2:])]
    size, rotation, x, y = (
        Metric(value=value, unit=unit, standard_error=float(error)) if known else None
        for value, unit, error, known in zip(values, ("", "deg", "mm", "mm"), units * errors, fit.fitted, strict=True)
    )
    return Alignment(displacement_x_mm=x, displacement_y_mm=y, scale=size, rotation_deg=rotation)


def pixels_of(corners: Float[np.ndarray, "4 2"]) -> tuple[Pixel, Pixel, Pixel, Pixel]:
    """Corners as a record has them."""
    first, second, third, fourth = ((float(column), float(row)) for column, row in corners)
    return first, second, third, fourth


def _target(shot: Shot, grid: PixelGrid) -> Size:
    """Width and height (mm) of the rectangle that the corners bound."""
    return grid.size if shot.target_mm is None else (shot.target_mm, shot.target_mm)


@dataclass(frozen=True)
class LightOnTarget:
    """A photograph on the receiver, scaled to a mean of 1; the share that the camera clipped; and its corners."""

    light: Float[np.ndarray, "h w"]
    clipped: float
    corners: Float[np.ndarray, "4 2"]


def _picture(shot: Shot, grid: PixelGrid, reference: Float[np.ndarray, "h w"]) -> tuple[LightOnTarget, Located | None]:
    """The photograph on the receiver, and how its corners were found if they were not given."""
    if min(grid.shape) < _LEAST_PIXELS:
        raise InputError(
            f"the simulation has {grid.columns} x {grid.rows} pixels, must be at least {_LEAST_PIXELS} x "
            f"{_LEAST_PIXELS} to be compared with a photograph; evaluate with more pixels"
        )
    on = read_photograph(shot.on, shot.gamma)
    dark = read_photograph(shot.off, shot.gamma, on.orientation) if shot.off else None
    lit = lit_only(on, dark)
    target_mm = _target(shot, grid)
    if shot.corners is not None:
        return light_on_target(lit, shot.on, shot.corners, target_mm, grid), None
    square = located_target(on, dark, reference, lit_square=shot.target_mm is not None)
    seen = light_on_target(lit, shot.on, square.corners, target_mm, grid)
    require_upright(seen.light, reference, square.corners)
    return seen, square.located


def located_target(
    on: Photograph, off: Photograph | None, simulated: Float[np.ndarray, "h w"], *, lit_square: bool = False
) -> Square:
    """Find the target of the ``simulated`` light in the photographs; ``lit_square``: as of :func:`locate`."""
    border = np.concatenate([simulated[0], simulated[-1], simulated[:, 0], simulated[:, -1]])
    share = float(border.mean() / simulated.max())
    return locate(on.light, None if off is None else off.light, border_share=share, lit_square=lit_square)


def light_on_target(
    picture: Photograph, path: Path, corners: Float[np.ndarray, "4 2"], target_mm: Size, grid: PixelGrid
) -> LightOnTarget:
    """Light of the ``picture`` of ``path`` on the pixels of ``grid``; ``target_mm``: of the rectangle of the corners.

    Raises :class:`InputError` for a receiver that is dark, or partly outside the picture.
    """
    image = rectify(picture.light, corners, target_mm, grid)
    unseen = float(np.isnan(image).mean())
    if unseen > 0.0:
        raise InputError(
            f"corners: {unseen:.1%} of the receiver of {grid.width:g} x {grid.height:g} mm lies outside {path}; "
            f"are they those of a target of {target_mm[0]:g} x {target_mm[1]:g} mm?"
        )
    if image.mean() <= 0.0:
        raise InputError(f"{path}: within the corners no brighter than with the LED off; are on and off interchanged?")
    clipped = float(rectify(picture.clipped.astype(np.float64), corners, target_mm, grid).mean())
    return LightOnTarget(normalised(image), clipped, corners)


def _evenness(image: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"] | None) -> Evenness:
    if mask is None or not mask.any():
        return Evenness(uniformity=None, rsd=None)
    return Evenness(uniformity=uniformity(image, mask), rsd=relative_deviation(image, mask))
