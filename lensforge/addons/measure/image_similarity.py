"""Similarity of two images of the same light, and the similarity transform between them, by least squares.

The photograph M at p' = s R(theta) p + t shows the light that the simulation S has at p. Fitted over all pixels are
ln s, theta and t, with gain and offset of M as nuisances: M(p') = gain S(p) + offset. Both are smoothed by a pixel,
against noise. The search starts from the shift by cross-correlation and from several sizes and rotations, on coarse
pictures.

Standard errors are by the jackknife over blocks of the picture, since the differences of two pictures are alike in
neighbouring pixels: differences wider than a block are not in them. Noise has slopes, too, and they would seem to tell
the size and rotation of any light: a parameter is fitted only where its slopes are well above those of the
differences.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter
from scipy.optimize import least_squares

from lensforge.addons.measure.measurement_result import Similarity
from lensforge.addons.measure.target_corners import means
from lensforge.results.estimates import jackknife_error, relative_square
from lensforge.scene.pixel_grid import PixelGrid

_SIGMA = 1.5  # pixels: the Gaussian window of Wang et al.
_SUBPIXEL = 50


def normalised(image: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Scale ``image`` to a mean of 1."""
    return np.asarray(image / image.mean())


def similarity(measured: Float[np.ndarray, "h w"], simulated: Float[np.ndarray, "h w"]) -> Similarity:
    """Compare two normalised images of at least 11 x 11 pixels.

    SSIM as in Z. Wang et al., "Image quality assessment: from error visibility to structural similarity", IEEE Trans.
    Image Process. 13 (2004): Gaussian window of 1.5 pixels, K = (0.01, 0.03), the dynamic range that of ``simulated``.
    """
    from skimage.metrics import structural_similarity

    ssim = structural_similarity(
        measured,
        simulated,
        data_range=float(simulated.max() - simulated.min()),
        gaussian_weights=True,
        sigma=_SIGMA,
        use_sample_covariance=False,
    )
    return Similarity(ssim=float(ssim), nmse=relative_square(np.stack([measured, simulated])))


def displacement(measured: Float[np.ndarray, "h w"], simulated: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "2"]:
    """Displacement (pixels along x, y) of the pattern ``measured`` from ``simulated``, by cross-correlation."""
    from skimage.registration import phase_cross_correlation

    back = phase_cross_correlation(
        simulated - simulated.mean(), measured - measured.mean(), upsample_factor=_SUBPIXEL, normalization=None
    )[0]
    return -np.asarray(back, dtype=np.float64)[::-1]


_SMOOTHED = 1.0  # pixels
_COARSE = 24  # pixels along the shorter side, for the choice of the start
_SIZES = (-0.3, -0.15, 0.0, 0.15, 0.3)  # ln s of the starts
_TURNS_RAD = (-0.4, -0.2, 0.0, 0.2, 0.4)  # theta of the starts
_STARTS = 2  # of them are followed, those that fit best
_MOST = np.array([np.log(2.0), np.pi / 4.0, 0.5, 0.5])  # shifts in sides of the picture
_BLOCKS = 5  # along each side
_SLOPES = 4.0  # least ratio of the squared slopes of the light to those of the differences
_ROUND = 1e-3  # of the squared slopes by size: below, the light is even or round


@dataclass(frozen=True)
class SimilarityFit:
    """``parameters`` ln s, theta (rad), shift along x and y (mm), with their standard ``errors``; 0 where not fitted.

    ``fitted``: those that the light determines.
    """

    parameters: Float[np.ndarray, "4"]
    errors: Float[np.ndarray, "4"]
    fitted: Bool[np.ndarray, "4"]


def fit_similarity(
    measured: Float[np.ndarray, "h w"], simulated: Float[np.ndarray, "h w"], grid: PixelGrid
) -> SimilarityFit:
    """Fit size, rotation and shift of ``measured`` against ``simulated``, both on the pixels of ``grid`` (mm)."""
    fitted = np.ones(4, dtype=bool)
    start = _start(measured, simulated, grid)
    pair = _Pair.of(measured, simulated, grid)
    parameters = pair.fit(start, fitted)
    fitted = pair.determined(parameters)
    if not fitted.all():
        parameters = pair.fit(np.where(fitted, parameters, 0.0), fitted)
    return SimilarityFit(parameters, pair.errors(parameters, fitted), fitted)


def _start(
    measured: Float[np.ndarray, "h w"], simulated: Float[np.ndarray, "h w"], grid: PixelGrid
) -> Float[np.ndarray, "4"]:
    step = max(1, min(grid.shape) // _COARSE)
    seen = means(measured, step)
    light = means(simulated, step)
    rows, columns = seen.shape
    width, height = grid.pixel
    pair = _Pair.of(seen, light, PixelGrid(columns * step * width, rows * step * height, columns, rows))
    shift = displacement(measured, simulated) * grid.pixel
    starts = [np.array([size, turn, *shift]) for size in _SIZES for turn in _TURNS_RAD]
    best = sorted(starts, key=pair.misfit)[:_STARTS]
    return min((pair.fit(start, np.ones(4, dtype=bool)) for start in best), key=pair.misfit)


def moved_back(image: Float[np.ndarray, "h w"], fit: SimilarityFit, grid: PixelGrid) -> Float[np.ndarray, "h w"]:
    """Undo the transform of ``image``; its edge is repeated outwards."""
    log_scale, angle, *shift = fit.parameters
    places = np.exp(log_scale) * _turned(_places(grid), angle) + np.array(shift)[:, None]
    return _read(spline_filter(image), places, grid).reshape(grid.shape)


@dataclass(frozen=True)
class _Pair:
    """Smoothed photograph, and spline coefficients of the smoothed simulation."""

    measured: Float[np.ndarray, " n"]
    spline: Float[np.ndarray, "h w"]
    grid: PixelGrid

    @staticmethod
    def of(measured: Float[np.ndarray, "h w"], simulated: Float[np.ndarray, "h w"], grid: PixelGrid) -> "_Pair":
        seen, light = (gaussian_filter(image, _SMOOTHED, mode="nearest") for image in (measured, simulated))
        return _Pair(seen.ravel(), spline_filter(light), grid)

    def fit(self, start: Float[np.ndarray, "4"], fitted: Bool[np.ndarray, "4"]) -> Float[np.ndarray, "4"]:
        """Least squares over the ``fitted`` parameters from ``start``, gain and offset projected out."""
        if not fitted.any():
            return np.zeros(4)
        unit = self._units()

        def whole(chosen: Float[np.ndarray, " k"]) -> Float[np.ndarray, "4"]:
            parameters = np.zeros(4)
            parameters[fitted] = chosen
            parameters *= unit
            return parameters

        begin = np.clip(start / unit, -0.9 * _MOST, 0.9 * _MOST)[fitted]
        solution = least_squares(
            lambda chosen: self.residual(whole(chosen)),
            begin,
            bounds=(-_MOST[fitted], _MOST[fitted]),
            xtol=1e-6,
            max_nfev=30,
        )
        return whole(solution.x)

    def misfit(self, parameters: Float[np.ndarray, "4"]) -> float:
        """Sum of the squared differences."""
        return float(np.sum(self.residual(parameters) ** 2))

    def residual(self, parameters: Float[np.ndarray, "4"]) -> Float[np.ndarray, " n"]:
        """Photograph less the transformed simulation with its best gain and offset."""
        light = self._nuisances(parameters)
        return np.asarray(self.measured - light @ self._weights(light))

    def _weights(self, light: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2"]:
        inverse = np.linalg.pinv(light.T @ light, hermitian=True)
        return np.asarray(inverse @ (light.T @ self.measured))

    def determined(self, parameters: Float[np.ndarray, "4"]) -> Bool[np.ndarray, "4"]:
        """True where the light's slope by a parameter is well above the slopes of the differences and of rounding."""
        light = self._nuisances(parameters)
        gain = self._weights(light)[0]
        slopes = gain * self._slopes(parameters, self.spline)
        apart = self._slopes(parameters, spline_filter(self.residual(parameters).reshape(self.grid.shape)))
        shares = np.array([_apart_from(slopes[:, k], np.delete(slopes, k, axis=1), light) for k in range(4)])
        least = np.maximum(_SLOPES * np.sum(apart**2, axis=0), _ROUND * np.sum(slopes**2, axis=0).max())
        return np.asarray(shares > least)

    def errors(self, parameters: Float[np.ndarray, "4"], fitted: Bool[np.ndarray, "4"]) -> Float[np.ndarray, "4"]:
        """Standard errors by the jackknife over blocks of the picture, in the linear model around the fit."""
        light = self._nuisances(parameters)
        left = self.residual(parameters)
        gain = self._weights(light)[0]
        design = np.concatenate([gain * self._slopes(parameters, self.spline)[:, fitted], light], axis=1)
        normal = design.T @ design
        left_out = []
        for block in _blocks(self.grid):
            rows = design[block]
            left_out.append(np.linalg.lstsq(normal - rows.T @ rows, rows.T @ left[block], rcond=None)[0])
        errors = np.zeros(4)
        errors[fitted] = [jackknife_error(values) for values in np.array(left_out).T[: fitted.sum()]]
        errors *= self._units()
        return errors

    def _units(self) -> Float[np.ndarray, "4"]:
        """Units of the parameters in a fit: shifts in sides of the picture."""
        return np.array([1.0, 1.0, *self.grid.size])

    def _nuisances(self, parameters: Float[np.ndarray, "4"]) -> Float[np.ndarray, "n 2"]:
        return np.stack([self._moved(parameters, self.spline), np.ones(len(self.measured))], axis=1)

    def _moved(self, parameters: Float[np.ndarray, "4"], spline: Float[np.ndarray, "h w"]) -> Float[np.ndarray, " n"]:
        log_scale, angle, *shift = parameters
        back = _turned(_places(self.grid) - np.array(shift)[:, None], -angle) * np.exp(-log_scale)
        return _read(spline, back, self.grid)

    def _slopes(self, parameters: Float[np.ndarray, "4"], spline: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "n 4"]:
        """Derivatives of the transformed picture by the parameters, in their units, by central differences."""
        steps = 1e-3 * np.diag(self._units())
        pairs = [(self._moved(parameters + step, spline), self._moved(parameters - step, spline)) for step in steps]
        return np.stack([(above - below) / 2e-3 for above, below in pairs], axis=1)


def _apart_from(slope: Float[np.ndarray, " n"], *other_slopes: Float[np.ndarray, "n _"]) -> float:
    """Squared norm of the part of ``slope`` that ``other_slopes`` cannot explain."""
    explaining = np.concatenate(other_slopes, axis=1)
    return float(np.sum((slope - explaining @ np.linalg.lstsq(explaining, slope, rcond=None)[0]) ** 2))


def _places(grid: PixelGrid) -> Float[np.ndarray, "2 n"]:
    """x and y (mm) of the pixels, row by row."""
    x, y = np.meshgrid(grid.x(), grid.y())
    return np.stack([x.ravel(), y.ravel()])


def _turned(places: Float[np.ndarray, "2 n"], angle: float) -> Float[np.ndarray, "2 n"]:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.asarray(np.array([[cosine, -sine], [sine, cosine]]) @ places)


def _read(
    spline: Float[np.ndarray, "h w"], places: Float[np.ndarray, "2 n"], grid: PixelGrid
) -> Float[np.ndarray, " n"]:
    """Values at ``places`` (mm) of a picture by its spline coefficients; its edge is repeated outwards."""
    x, y = places
    columns = np.clip((x - grid.x()[0]) / grid.pixel[0], 0.0, grid.columns - 1.0)
    rows = np.clip((y - grid.y()[0]) / grid.pixel[1], 0.0, grid.rows - 1.0)
    return np.asarray(map_coordinates(spline, [rows, columns], order=3, mode="mirror", prefilter=False))


def _blocks(grid: PixelGrid) -> list[Bool[np.ndarray, " n"]]:
    rows, columns = np.indices(grid.shape)
    number = (rows * _BLOCKS // grid.rows) * _BLOCKS + columns * _BLOCKS // grid.columns
    return [number.ravel() == block for block in range(_BLOCKS**2)]
