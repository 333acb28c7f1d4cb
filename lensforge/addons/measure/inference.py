"""Errors of a made lens from pictures of its light: the pictures on the receiver, the fit, and the best further one."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.addons.measure.form_fit import OTHERWISE, FormFit, covariance_with, fit_form
from lensforge.addons.measure.form_unknowns import FormUnknowns
from lensforge.addons.measure.image_similarity import normalised
from lensforge.addons.measure.inference_result import FurtherPicture, Inference, InferredError
from lensforge.addons.measure.measurement_result import Located
from lensforge.addons.measure.photo_comparison import (
    CORNER_PX,
    LightOnTarget,
    Photograph,
    light_on_target,
    lit_only,
    located_target,
    pixels_of,
    read_photograph,
    require_upright,
)
from lensforge.addons.measure.picture_model import Camera, PictureModel, Pictures
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

_FITTED = range(16)  # samples of the rays of the pictures that are fitted
_SLOPED = range(16, 20)  # of those of slopes
_DESIGNED = range(20, 21)  # of those by which a mirrored picture is told
_ANOTHER = 5.0  # chi-square of a lens that is another
_LEAST_MM = 0.1  # by which a further picture has the LED moved
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
    share = max(rays // len(_FITTED), 1)
    model = PictureModel(traced, receiver, judging_source(lens.spec), unknowns, places, _FITTED, share, seed)
    designed = model.by(_DESIGNED).pictures(np.zeros(len(unknowns)))[0]
    seen = _rectified(shots, receiver, designed)
    width_px = float(np.linalg.norm(seen.corners[1] - seen.corners[0]))
    camera = Camera(receiver.grid, len(places), CORNER_PX * receiver.grid.columns / width_px)
    fit = fit_form(seen.light, model, camera, model.by(_SLOPED))
    if fit.chi_square > _ANOTHER:
        raise InputError(
            f"pictures: no low-order errors of this lens explain them, chi-square {fit.chi_square:.3g}, at most "
            f"{_ANOTHER:g}; {OTHERWISE}"
        )
    of_lens = len(unknowns)  # the numbers of the camera stand behind
    covariance = max(1.0, fit.chi_square) * fit.covariance[:of_lens, :of_lens]
    errors = _errors(unknowns, fit, np.sqrt(np.diag(covariance)))
    inner, outer = (_form(errors[unknowns.of_face(face)]) for face in unknowns.names)
    return Inference(
        inputs={"lens": lens.sha256},
        pictures=tuple(path.name for path in shots.on),
        led_mm=tuple(places),
        corners=pixels_of(seen.corners),
        corners_located=seen.located,
        inner_form_um=inner,
        outer_form_um=outer,
        errors=errors,
        covariance=covariance,
        further=_further(model.by(_SLOPED[:2]), camera, fit),
        chi_square=fit.chi_square,
        over_expected=max(abs(error.value.value) / error.expected for error in errors),
        clipped=seen.clipped,
        noise_percent=100.0 * fit.noise / float(designed.mean()),
        pixels=pixels,
        rays=share * len(_FITTED),
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


class _Rectified(NamedTuple):
    """Light on the pixels of the receiver in each photograph, scaled to a mean of 1, and the corners of the target.

    ``clipped``: overexposed share of the worst. ``located``: quality of corners that were looked for; None if given.
    """

    light: Pictures
    clipped: float
    corners: Float[np.ndarray, "4 2"]
    located: Located | None


def _rectified(shots: Shots, receiver: PosedReceiver, designed: Pictures) -> _Rectified:
    """Rectify the photographs. Raises :class:`InputError` for any that cannot be of the ``designed`` light."""
    first = read_photograph(shots.on[0], shots.gamma)
    dark = None if shots.off is None else read_photograph(shots.off, shots.gamma, first.orientation)
    located = None
    corners = shots.corners
    if corners is None:
        square = located_target(first, dark, designed[0])
        located = square.located
        corners = square.corners
    seen = [_light(path, shots.gamma, first, dark, corners, receiver) for path in shots.on]
    for picture, simulated in zip(seen, designed, strict=True):
        require_upright(picture.light, normalised(simulated), corners)
    light = np.stack([picture.light for picture in seen])
    return _Rectified(light, max(picture.clipped for picture in seen), corners, located)


def _light(
    path: Path,
    gamma: float,
    first: Photograph,
    dark: Photograph | None,
    corners: Float[np.ndarray, "4 2"],
    receiver: PosedReceiver,
) -> LightOnTarget:
    photograph = read_photograph(path, gamma, first.orientation)
    if photograph.light.shape != first.light.shape:
        raise InputError(f"{path}: of another size than the first picture; take all with the same camera on its stand")
    return light_on_target(lit_only(photograph, dark), path, corners, receiver.grid.size, receiver.grid)


def _errors(
    unknowns: FormUnknowns, fit: FormFit, standard_errors: Float[np.ndarray, " k"]
) -> tuple[InferredError, ...]:
    remaining = np.minimum(np.sqrt(np.diag(fit.posterior)), 1.0)
    return tuple(
        InferredError(
            name=unknown.name,
            value=Metric(
                value=float(number * unknown.expected),
                unit=unknown.unit,
                standard_error=float(error * unknown.expected),
            ),
            expected=unknown.expected,
            remaining=float(share),
        )
        for unknown, number, error, share in zip(
            unknowns.unknowns, fit.numbers, standard_errors, remaining, strict=False
        )
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
    before = np.sqrt(np.diag(fit.posterior)[: len(model.unknowns)])
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
