"""A photograph of the part's light against the simulation, as in the paper's Fig. 7."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from lensforge.errors import InputError
from lensforge.light.metrics import relative_deviation, uniformity
from lensforge.made.image_similarity import SimilarityFit, fit_similarity, moved_back, normalised, similarity
from lensforge.made.measurement_result import Alignment, Evenness, Located, PhotoComparison, Pixel, photo_criteria
from lensforge.made.photograph import Photograph, Size, lit_only, read_photograph, rectify, require_upright
from lensforge.made.target_corners import locate
from lensforge.results import Metric
from lensforge.scene.pixel_grid import PixelGrid

_LEAST_PIXELS = 11  # the window of SSIM
_CORNER_PX = 0.2  # scatter of a corner that was found, along each axis; one given by hand is hardly better


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
    shot: Shot,
    *,
    simulated: Float[np.ndarray, "h w"],
    grid: PixelGrid,
    uniform: Bool[np.ndarray, "h w"] | None,
    inputs: Mapping[str, str] | None = None,
) -> PhotoComparison:
    """Compare ``shot`` with the ``simulated`` irradiance ([y, x], any unit) on a plane with the pixels ``grid`` (mm).

    Both images are scaled to a mean of 1. ``uniform``: pixels whose uniformity is compared. ``inputs``: hashes of what
    was simulated, by name. Raises :class:`InputError` for photographs or corners that cannot be used.
    """
    reference = normalised(simulated)
    picture, located = _picture(shot, grid, reference)
    measured = picture.light
    fit = fit_similarity(measured, reference, grid)
    alike = similarity(measured, reference)
    return PhotoComparison(
        inputs=dict(inputs or {}),
        on=shot.on.name,
        off=shot.off.name if shot.off else None,
        corners=_corners(picture.corners),
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
        criteria=photo_criteria(picture.clipped),
        measured=measured,
        simulated=reference,
    )


def _corner_error(corners: Float[np.ndarray, "4 2"], target_mm: Size) -> Float[np.ndarray, "4"]:
    """Standard errors of ln s, rotation (rad) and shifts (mm) by the target's corners: a rectangle fitted."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    width, height = 0.5 * (sides[0] + sides[2]), 0.5 * (sides[1] + sides[3])
    relative = _CORNER_PX / float(np.hypot(width, height))
    return np.array([relative, relative, *(0.5 * _CORNER_PX * np.array(target_mm) / (width, height))])


def _alignment(fit: SimilarityFit, by_corners: Float[np.ndarray, "4"]) -> Alignment:
    """The fit as a record, its errors with those of the corners."""
    scale, errors = float(np.exp(fit.parameters[0])), np.hypot(fit.errors, by_corners)
    units = np.array([scale, np.degrees(1.0), 1.0, 1.0])
    values = [scale, float(np.degrees(fit.parameters[1])), *map(float, fit.parameters[2:])]
    size, rotation, x, y = (
        Metric(value=value, unit=unit, standard_error=float(error)) if known else None
        for value, unit, error, known in zip(values, ("", "deg", "mm", "mm"), units * errors, fit.fitted, strict=True)
    )
    return Alignment(displacement_x_mm=x, displacement_y_mm=y, scale=size, rotation_deg=rotation)


def _corners(corners: Float[np.ndarray, "4 2"]) -> tuple[Pixel, Pixel, Pixel, Pixel]:
    first, second, third, fourth = ((float(column), float(row)) for column, row in corners)
    return first, second, third, fourth


def _target(shot: Shot, grid: PixelGrid) -> Size:
    """Width and height (mm) of the rectangle that the corners bound."""
    return grid.size if shot.target_mm is None else (shot.target_mm, shot.target_mm)


@dataclass(frozen=True)
class _OnTarget:
    """The photograph on the receiver, scaled to a mean of 1; the share that the camera clipped; and its corners."""

    light: Float[np.ndarray, "h w"]
    clipped: float
    corners: Float[np.ndarray, "4 2"]


def _picture(shot: Shot, grid: PixelGrid, reference: Float[np.ndarray, "h w"]) -> tuple[_OnTarget, Located | None]:
    """The photograph on the receiver, and how its corners were found if they were not given."""
    if min(grid.shape) < _LEAST_PIXELS:
        raise InputError(
            f"the simulation has {grid.columns} x {grid.rows} pixels, must be at least {_LEAST_PIXELS} x "
            f"{_LEAST_PIXELS} to be compared with a photograph; evaluate with more pixels"
        )
    on = read_photograph(shot.on, shot.gamma)
    dark = read_photograph(shot.off, shot.gamma, on.orientation) if shot.off else None
    lit = lit_only(on, dark)
    if shot.corners is not None:
        return _on_target(lit, shot, shot.corners, grid), None
    square = locate(
        on.light,
        None if dark is None else dark.light,
        border_share=_border_share(reference),
        lit_square=shot.target_mm is not None,
    )
    seen = _on_target(lit, shot, square.corners, grid)
    require_upright(seen.light, reference, square.corners)
    return seen, square.located


def _on_target(picture: Photograph, shot: Shot, corners: Float[np.ndarray, "4 2"], grid: PixelGrid) -> _OnTarget:
    target_mm = _target(shot, grid)
    image = rectify(picture.light, corners, target_mm, grid)
    unseen = float(np.isnan(image).mean())
    if unseen > 0.0:
        raise InputError(
            f"corners: {unseen:.1%} of the receiver of {grid.width:g} x {grid.height:g} mm lies outside {shot.on}; "
            f"are they those of a target of {target_mm[0]:g} x {target_mm[1]:g} mm?"
        )
    if image.mean() <= 0.0:
        raise InputError(
            f"{shot.on}: within the corners no brighter than with the LED off; are on and off interchanged?"
        )
    clipped = float(rectify(picture.clipped.astype(np.float64), corners, target_mm, grid).mean())
    return _OnTarget(normalised(image), clipped, corners)


def _border_share(reference: Float[np.ndarray, "h w"]) -> float:
    """Mean of the simulation at its border over its peak."""
    border = np.concatenate([reference[0], reference[-1], reference[:, 0], reference[:, -1]])
    return float(border.mean() / reference.max())


def _evenness(image: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"] | None) -> Evenness:
    if mask is None or not mask.any():
        return Evenness(uniformity=None, rsd=None)
    return Evenness(uniformity=uniformity(image, mask), rsd=relative_deviation(image, mask))
