"""The unknowns of a lens that explain its pictures best, by Gauss-Newton steps, and their standard errors.

Numbers are in units of their prior standard deviations: their prior covariance is the identity, their posterior one the
inverse of identity plus Fisher information. That is summed over pairs of slopes by different rays alone: noise that
both have in common would count as information. Standard errors are those of the estimator: by noise of the camera,
scatter of the model by its samples of rays, and the bias towards the prior mean.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter

from lensforge.addons.measure.picture_model import BLUR_PX, Camera, Numbers, PictureModel, Pictures, blurred
from lensforge.errors import InputError, refused

OTHERWISE = (
    "are the LED's places those of the pictures, in their order, is the dark picture given, and is it this lens?"
)
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
        weight = weights.ravel()
        total = np.zeros((slopes.shape[1], len(weight)))
        alike = np.zeros((len(total), len(total)))
        for sample in slopes:
            flat = sample.reshape(total.shape).astype(np.float64)
            total += flat
            alike += (flat * weight) @ flat.T
        matrix = ((total * weight) @ total.T - alike) / (count * (count - 1))
        return Information(matrix, total / count * weight)

    @cached_property
    def covariance(self) -> Float[np.ndarray, "k k"]:
        """Posterior covariance of the numbers."""
        values, vectors = np.linalg.eigh(self.matrix)
        return np.asarray((vectors / (1.0 + np.maximum(values, 0.0))) @ vectors.T)

    @cached_property
    def estimator(self) -> Float[np.ndarray, "k n"]:
        """Matrix from the residual of the pictures to a step of the numbers."""
        return np.asarray(self.covariance @ self.weighted)


@dataclass(frozen=True, eq=False)
class FormFit:
    """Numbers, those of the camera behind those of the lens, the covariance of their errors, and what they rest on.

    ``posterior``: covariance of the numbers. ``chi_square``: mean over the lit pixels of the
    squared residual over its variance, 1 for a lens whose errors are all among the unknowns. ``residual``:
    pictures less those of the model. ``noise``: of the camera in a pixel.
    """

    numbers: Numbers
    covariance: Float[np.ndarray, "k k"]
    posterior: Float[np.ndarray, "k k"]
    chi_square: float
    residual: Pictures
    noise: float


def camera_noise(light: Pictures) -> float:
    """Standard deviation of the white noise in a pixel, by mixed second differences, which a smooth picture has not."""
    fine = np.diff(np.diff(light, 2, axis=1), 2, axis=2) / _DIFFERENCE
    return float(np.sqrt(np.median(np.square(fine)) / _MEDIAN_OF_SQUARE))


def fit_form(light: Pictures, model: PictureModel, camera: Camera, sloped: PictureModel) -> FormFit:
    """Fit the numbers of ``model`` and ``camera`` to rectified pictures in any unit.

    ``sloped``: the model by the rays of slopes. All pictures of the model are by the same rays, so that steps end.
    Raises :class:`InputError` for light that reaches no pixel off the border.
    """
    of_lens = len(model.unknowns)
    numbers = np.zeros(of_lens + len(camera))

    def seen() -> Float[np.ndarray, "r p h w"]:
        pictures = model.pictures(numbers[:of_lens])
        return np.stack([camera.seen(picture, numbers[of_lens:]) for picture in pictures])

    pictures = seen()
    unit = pictures.mean(axis=(0, 2, 3)) / light.mean(axis=(1, 2))
    scaled = light * unit[:, None, None]
    noise = camera_noise(scaled)
    data = blurred(scaled)
    weights = _weights(pictures, noise)
    if not weights.any():
        raise InputError(
            "pictures: the design has light along the border of its receiver alone; make the receiver larger"
        )
    for _ in range(_ROUNDS):
        information = Information.of(_slopes(sloped, camera, numbers), weights)
        for _ in range(_STEPS):
            step = information.estimator @ (data - pictures.mean(axis=0)).ravel() - information.covariance @ numbers
            numbers = numbers + step
            with refused("pictures", f"no low-order errors of this lens explain them (…); {OTHERWISE}", InputError):
                pictures = seen()
            if np.linalg.norm(step) < _SETTLED:
                break
    residual = data - pictures.mean(axis=0)
    chi_square = _SHARED * float((weights * residual**2).sum() / np.count_nonzero(weights))
    covariance = _covariance(information, pictures, noise)
    return FormFit(numbers, covariance, information.covariance, chi_square, residual, noise)


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


def _covariance(
    information: Information, pictures: Float[np.ndarray, "r p h w"], noise: float
) -> Float[np.ndarray, "k k"]:
    """Covariance of the errors of the numbers that the estimator gives."""
    estimator = information.estimator
    by_model = np.cov(estimator @ pictures.reshape(len(pictures), -1).T) / len(pictures)
    spread = np.stack([blurred(row.reshape(pictures.shape[1:])).ravel() for row in estimator])
    by_camera = noise**2 * spread @ spread.T
    by_prior = information.covariance @ information.covariance
    return np.asarray(by_model + by_camera + by_prior)


def covariance_with(model: PictureModel, camera: Camera, fit: FormFit) -> Float[np.ndarray, "k k"]:
    """Covariance of the numbers of the lens by all pictures of ``fit`` and by one more, the picture of ``model``."""
    of_lens = len(model.unknowns)
    alone = replace(camera, count=1)
    pictures = model.pictures(fit.numbers[:of_lens])
    numbers = np.r_[fit.numbers[:of_lens], np.zeros(len(alone))]
    more = Information.of(_slopes(model, alone, numbers), _weights(pictures, fit.noise)).matrix
    kept = np.r_[
        :of_lens, of_lens + camera.count : of_lens + len(camera)
    ]  # all pictures have the corners, each its brightness
    before = np.eye(len(more))
    shared = np.r_[:of_lens, of_lens + 1 : len(more)]
    before[np.ix_(shared, shared)] = fit.posterior[np.ix_(kept, kept)]
    values, vectors = np.linalg.eigh(more)
    gained = (vectors * np.maximum(values, 0.0)) @ vectors.T
    after = np.linalg.inv(np.linalg.inv(before) + gained)
    return np.asarray(after[:of_lens, :of_lens])
