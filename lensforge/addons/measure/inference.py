"""Errors of a made lens from pictures of its light: the pictures on the receiver, the fit, and the best further one."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.addons.measure.form_fit import FormFit, covariance_with, fit_form
from lensforge.addons.measure.form_unknowns import FormUnknowns
from lensforge.addons.measure.image_similarity import normalised
from lensforge.addons.measure.inference_result import FurtherPicture, Inference, InferredError
from lensforge.addons.measure.photo_comparison import (
    CORNER_PX,
    Photograph,
    lit_only,
    read_photograph,
    rectify,
    require_upright,
)
from lensforge.addons.measure.picture_model import Camera, PictureModel, Pictures
from lensforge.addons.measure.target_corners import Square, listed, locate
from lensforge.errors import InputError
from lensforge.light.lens_light import judging_source
from lensforge.light.simulation import TracedLens
from lensforge.optics.pose import Vector
from lensforge.results import Metric
from lensforge.results.files import MIB
from lensforge.results.text_table import TextTable
from lensforge.scene.body import Chain
from lensforge.scene.lens import Lens
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.spec.accuracy import preset_of

_REPLICATES = 16
_OF_SLOPES = 4  # samples of rays, as large as a replicate
_SLOPES_ON = 2**20  # seeds of the slopes are so far on
_ANOTHER = 5.0  # chi-square of a lens that is another
_DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])


@dataclass(frozen=True)
class Shots:
    """Photographs by the same camera on its stand, each with the LED moved by a row of ``led_mm``, and one without it.

    ``corners``: of the target in all; None: they are looked for.
    """

    on: tuple[Path, ...]
    led_mm: Float[np.ndarray, "p 3"]
    off: Path | None
    corners: Float[np.ndarray, "4 2"] | None
    gamma: float


def led_places(path: Path, pictures: int) -> Float[np.ndarray, "p 3"]:
    """Places of the LED (mm) in a table of x, y, z, a row for each of the ``pictures``. Raises :class:`InputError`."""
    table = TextTable.read(path, missing="give a table of x, y, z in mm, a row for each picture", most_bytes=MIB)
    places = table.numbers(used=[0, 1, 2])
    if len(places) != pictures:
        raise InputError(
            f"poses: {path} has {len(places)} rows, there are {pictures} pictures; give the LED's x, y, z (mm) in "
            "each, in the order of the pictures"
        )
    return places


def infer_errors(lens: Lens, shots: Shots, *, expected_um: float, pixels: int, rays: int, seed: int) -> Inference:
    """Fit the errors of ``lens`` to ``shots``; ``rays``: of each picture of the model.

    Raises :class:`InputError` for photographs that cannot be of this lens.
    """
    started = time.perf_counter()
    traced = TracedLens.of(lens, preset_of(lens.accuracy).evaluate_nodes_per_sigma)
    unknowns = FormUnknowns.of(lens, traced, expected_um)
    places: list[Vector] = [(float(x), float(y), float(z)) for x, y, z in shots.led_mm]
    receiver = receivers_of(lens.spec, pixels)[0]
    source = judging_source(lens.spec)
    share = max(rays // _REPLICATES, 1)
    model = PictureModel(traced, receiver, source, unknowns, places, share, _REPLICATES, seed)
    sloped = model.of_rays(share, _OF_SLOPES, _SLOPES_ON)
    designed = model.of_rays(share, 1, 0).pictures(np.zeros(len(unknowns)))[0]
    light, square, corners = _rectified(shots, receiver, designed)
    for picture, simulated in zip(light, designed, strict=True):
        require_upright(normalised(picture), normalised(simulated), corners)
    width_px = float(np.linalg.norm(corners[1] - corners[0]))
    camera = Camera(receiver.grid, len(places), CORNER_PX * receiver.grid.columns / width_px)
    fit = fit_form(light, model, camera, sloped)
    if fit.chi_square > _ANOTHER:
        raise InputError(
            f"pictures: no low-order errors of this lens explain them, chi-square {fit.chi_square:.3g}, at most "
            f"{_ANOTHER:g}; are the LED's places those of the pictures, in their order, and is it this lens?"
        )
    errors = _errors(unknowns, fit)
    inner, outer = (_form(errors[unknowns.of_face(face)]) for face in unknowns.names)
    return Inference(
        inputs={"lens": lens.sha256},
        pictures=tuple(path.name for path in shots.on),
        led_mm=tuple(places),
        corners=tuple((float(column), float(row)) for column, row in corners),
        corners_located=None if square is None else square.located,
        inner_form_um=inner,
        outer_form_um=outer,
        errors=errors,
        further=_further(replace(sloped, replicates=2), camera, fit),
        chi_square=fit.chi_square,
        over_expected=max(abs(error.value.value) / error.expected for error in errors),
        noise_percent=100.0 * fit.noise / float(designed.mean()),
        pixels=pixels,
        rays=share * _REPLICATES,
        seed=seed,
        seconds=time.perf_counter() - started,
    )


def require_pictures_of(lens: Lens) -> None:
    """Raise :class:`InputError` for a scene that is not read from pictures."""
    spec = lens.spec
    if Chain.of_lens(spec.lens) is not None or spec.lens.drawn_half_mm is not None:
        raise InputError(f"infer: a {spec.lens.title} is not read from pictures yet; only a lens of two freeform faces")
    if not spec.all_lamps.is_single:
        raise InputError("infer: pictures of several lamps are not read yet; take them of one lamp, for its own design")
    if not receivers_of(spec, 1)[0].is_flat:
        raise InputError("infer: the first receiver must be a plane for pictures; give the spec a plane first")


def _rectified(
    shots: Shots, receiver: PosedReceiver, designed: Pictures
) -> tuple[Pictures, Square | None, Float[np.ndarray, "4 2"]]:
    """Light on the pixels of ``receiver`` in each photograph, and the corners by which it was rectified."""
    first = read_photograph(shots.on[0], shots.gamma)
    dark = None if shots.off is None else read_photograph(shots.off, shots.gamma, first.orientation)
    square = None
    corners = shots.corners
    if corners is None:
        border = np.concatenate([designed[0, 0], designed[0, -1], designed[0, :, 0], designed[0, :, -1]])
        share = float(border.mean() / designed[0].max())
        square = locate(first.light, None if dark is None else dark.light, border_share=share)
        corners = square.corners
    light = [_light(path, shots.gamma, first, dark, corners, receiver) for path in shots.on]
    return np.stack(light), square, corners


def _light(
    path: Path,
    gamma: float,
    first: Photograph,
    dark: Photograph | None,
    corners: Float[np.ndarray, "4 2"],
    receiver: PosedReceiver,
) -> Float[np.ndarray, "h w"]:
    photograph = read_photograph(path, gamma, first.orientation)
    if photograph.light.shape != first.light.shape:
        raise InputError(f"{path}: of another size than the first picture; take all with the same camera on its stand")
    image = rectify(lit_only(photograph, dark).light, corners, receiver.grid.size, receiver.grid)
    if np.isnan(image).any() or not image.mean() > 0.0:
        raise InputError(f"{path}: the target, at {listed(corners)}, is dark or partly outside; give its corners")
    return image


def _errors(unknowns: FormUnknowns, fit: FormFit) -> tuple[InferredError, ...]:
    more = max(1.0, fit.chi_square) ** 0.5
    remaining = np.minimum(np.sqrt(np.diag(fit.by_expectation)), 1.0)
    return tuple(
        InferredError(
            name=unknown.name,
            value=Metric(
                value=float(number * unknown.expected),
                unit=unknown.unit,
                standard_error=float(more * error * unknown.expected),
            ),
            expected=unknown.expected,
            remaining=float(share),
        )
        for unknown, number, error, share in zip(
            unknowns.unknowns, fit.numbers, fit.errors, remaining, strict=False
        )  # those of the camera stand behind
    )


def _form(errors: Sequence[InferredError]) -> Metric:
    """Rms of the form errors of a face, less what their noise adds, and its standard error."""
    values = np.array([error.value.value for error in errors])
    noise = np.array([error.value.standard_error or 0.0 for error in errors])
    rms = float(np.sqrt(max(np.sum(values**2 - noise**2), 0.0)))
    length = max(float(np.linalg.norm(values)), 1e-12)
    spread = float(np.linalg.norm(values * noise)) / length
    return Metric(value=rms, unit="µm", standard_error=max(spread, float(np.sqrt(np.mean(noise**2)))))


def _further(model: PictureModel, camera: Camera, fit: FormFit) -> FurtherPicture:
    """The place of the LED, as far out as any along x, y or z, at which one more picture tells most."""
    most = max(float(np.abs(model.poses).max()), _LEAST_MM)
    own = len(model.unknowns)
    before = np.sqrt(np.diag(fit.by_expectation)[:own])
    places: list[Vector] = [(float(x), float(y), float(z)) for x, y, z in most * _DIRECTIONS]
    after = [np.sqrt(np.diag(covariance_with(replace(model, poses=[place]), camera, fit))) for place in places]
    best = int(np.argmin([np.square(shares).sum() for shares in after]))
    error = int(np.argmin(after[best] / before))
    return FurtherPicture(
        led_mm=places[best],
        error=model.unknowns.unknowns[error].name,
        remaining_before=float(min(before[error], 1.0)),
        remaining=float(min(after[best][error], before[error], 1.0)),
    )


_LEAST_MM = 0.1  # by which a further picture has the LED moved
