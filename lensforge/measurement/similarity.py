"""Similarity of two images of the same receiver, whatever their exposure."""

import numpy as np
from jaxtyping import Float

from lensforge.evaluation.metrics import relative_square
from lensforge.measurement.comparison import Similarity

_SIGMA = 1.5  # pixels: the Gaussian window of Wang et al.
_SUBPIXEL = 50


def normalised(image: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Scale ``image`` to a mean of 1."""
    scaled: Float[np.ndarray, "h w"] = image / image.mean()
    return scaled


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
