"""The unknowns of a lens that explain its pictures best, by Gauss-Newton steps, and their standard errors.

Numbers are in units of what is expected: before a picture is seen their covariance is the identity, and behind it the
inverse of identity plus Fisher information. That is summed over pairs of slopes by different rays alone: noise that
both have in common would count as information. Standard errors are those of the estimator: by noise of the camera,
scatter of the model by its replicates, and what the expectation adds.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter

from lensforge.addons.measure.picture_model import BLUR_PX, Camera, Numbers, PictureModel, Pictures, blurred

_LIT = 0.04  # of the brightest pixel: where it is darker, slopes are noise
_EDGE_PX = 4.0 * BLUR_PX  # from the border, beyond which light is unknown
_BROAD_PX = 4.0  # over which the scatter of few replicates is averaged
_SHARED = 4.0 * np.pi * BLUR_PX**2  # pixels that share their noise, by the blur
_ROUNDS = 2  # of slopes
_STEPS = 3  # of numbers, by the same slopes
_SETTLED = 0.2  # length of the last step
_MEDIAN_OF_SQUARE = 0.4549  # of a standard normal number
_DIFFERENCE = 6.0  # root of the sum of squares of the mixed second difference: white noise grows by it


@dataclass(frozen=True, eq=False)
class Information:
    """Fisher information (k, k) and the mean slopes (k, n) behind it, weighted by pixel."""

    matrix: Float[np.ndarray, "k k"]
    weighted: Float[np.ndarray, "k n"]

    @staticmethod
    def of(slopes: Float[np.ndarray, "r k p h w"], weights: Pictures) -> "Information":
        """Information in slopes by each of several samples of rays, two at least."""
        count = len(slopes)
        flat = slopes.reshape(count, slopes.shape[1], -1).astype(np.float64)
        total = flat.sum(axis=0)
        alike = sum((sample * weights.ravel()) @ sample.T for sample in flat)
        matrix = ((total * weights.ravel()) @ total.T - alike) / (count * (count - 1))
        return Information(matrix, total / count * weights.ravel())

    @cached_property
    def covariance(self) -> Float[np.ndarray, "k k"]:
        """Covariance of the numbers, with that of the expectation."""
        values, vectors = np.linalg.eigh(self.matrix)
        return np.asarray((vectors / (1.0 + np.maximum(values, 0.0))) @ vectors.T)

    @cached_property
    def estimator(self) -> Float[np.ndarray, "k n"]:
        """Numbers from what the pictures differ from those of no error."""
        return np.asarray(self.covariance @ self.weighted)


@dataclass(frozen=True, eq=False)
class FormFit:
    """Numbers, those of the camera behind those of the lens, their errors, and what they rest on.

    ``by_expectation``: covariance by information and expectation. ``chi_square``: mean over the lit pixels of the
    squared residual over its variance, 1 for a lens whose errors are all among the unknowns. ``residual``:
    pictures less those of the model. ``noise``: of the camera in a pixel.
    """

    numbers: Numbers
    errors: Numbers
    by_expectation: Float[np.ndarray, "k k"]
    chi_square: float
    residual: Pictures
    noise: float


def camera_noise(light: Pictures) -> float:
    """Standard deviation of the white noise in a pixel, by mixed second differences, which a smooth picture has not."""
    fine = [np.abs(_mixed_difference(picture)) for picture in light]
    return float(np.sqrt(np.median(np.square(fine)) / _MEDIAN_OF_SQUARE))


def _mixed_difference(picture: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "i j"]:
    twice = np.diff(np.diff(picture, 2, axis=0), 2, axis=1)
    return np.asarray(twice / _DIFFERENCE)


def fit_form(light: Pictures, model: PictureModel, camera: Camera, sloped: PictureModel) -> FormFit:
    """Fit the numbers of ``model`` and ``camera`` to rectified pictures in any unit.

    ``sloped``: the model by the rays of slopes. All pictures of the model are by the same rays, so that steps end.
    """
    own = len(model.unknowns)
    numbers = np.zeros(own + len(camera))

    def seen() -> Float[np.ndarray, "r p h w"]:
        pictures = model.pictures(numbers[:own])
        return np.stack([camera.seen(picture, numbers[own:]) for picture in pictures])

    pictures = seen()
    unit = pictures.mean(axis=(0, 2, 3)) / light.mean(axis=(1, 2))
    scaled = light * unit[:, None, None]
    noise = camera_noise(scaled)
    data = blurred(scaled)
    weights = _weights(pictures, noise)
    for _ in range(_ROUNDS):
        information = Information.of(_slopes(sloped, camera, numbers), weights)
        for _ in range(_STEPS):
            step = information.estimator @ (data - pictures.mean(axis=0)).ravel() - information.covariance @ numbers
            numbers = numbers + step
            pictures = seen()
            if np.linalg.norm(step) < _SETTLED:
                break
    residual = data - pictures.mean(axis=0)
    chi_square = _SHARED * float((weights * residual**2).sum() / np.count_nonzero(weights))
    return FormFit(numbers, _errors(information, pictures, noise), information.covariance, chi_square, residual, noise)


def _slopes(sloped: PictureModel, camera: Camera, numbers: Numbers) -> Float[np.ndarray, "s m p h w"]:
    """Slopes by the numbers of the lens and then of the camera, for each sample of rays.

    Those of the camera are of pictures by the same samples: slopes of the pictures that are fitted have their noise.
    """
    by_rays, seen_as = np.split(numbers, [len(sloped.unknowns)])
    pictures = sloped.pictures(by_rays)
    by_camera = [camera.slopes(camera.seen(picture, seen_as)) for picture in pictures]
    return np.concatenate([sloped.slopes(by_rays), np.stack(by_camera)], axis=1)


def _weights(pictures: Float[np.ndarray, "r p h w"], noise: float) -> Pictures:
    """Inverse variance of each lit pixel, by camera and rays, over the pixels that share their noise."""
    mean = pictures.mean(axis=0)
    by_rays = gaussian_filter(pictures.var(axis=0, ddof=1) / len(pictures), (0.0, _BROAD_PX, _BROAD_PX))
    lit = mean > _LIT * mean.max()
    edge = int(np.ceil(_EDGE_PX))
    inside = np.zeros_like(lit)
    inside[:, edge:-edge, edge:-edge] = True
    return np.asarray((lit & inside) / (noise**2 / _SHARED + by_rays) / _SHARED)


def _errors(information: Information, pictures: Float[np.ndarray, "r p h w"], noise: float) -> Numbers:
    """Standard errors of the numbers that the estimator gives."""
    estimator = information.estimator
    by_model = (estimator @ pictures.reshape(len(pictures), -1).T).var(axis=1, ddof=1) / len(pictures)
    spread = np.stack([blurred(row.reshape(pictures.shape[1:])) for row in estimator])
    by_camera = noise**2 * np.square(spread).sum(axis=(1, 2, 3))
    by_expectation = np.square(information.covariance).sum(axis=1)
    return np.sqrt(by_model + by_camera + by_expectation)


def covariance_with(model: PictureModel, camera: Camera, fit: FormFit) -> Float[np.ndarray, "k k"]:
    """Covariance of the numbers of the lens by all pictures of ``fit`` and by one more, the picture of ``model``."""
    own = len(model.unknowns)
    alone = replace(camera, count=1)
    pictures = model.pictures(fit.numbers[:own])
    numbers = np.r_[fit.numbers[:own], np.zeros(len(alone))]
    more = Information.of(_slopes(model, alone, numbers), _weights(pictures, fit.noise)).matrix
    kept = np.r_[:own, own + camera.count : own + len(camera)]  # all pictures have the corners, each its brightness
    before = np.eye(len(more))
    shared = np.r_[:own, own + 1 : len(more)]
    before[np.ix_(shared, shared)] = fit.by_expectation[np.ix_(kept, kept)]
    values, vectors = np.linalg.eigh(more)
    gained = (vectors * np.maximum(values, 0.0)) @ vectors.T
    after = np.linalg.inv(np.linalg.inv(before) + gained)
    return np.asarray(after[:own, :own])
