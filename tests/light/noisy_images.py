"""Known pictures, and replicates of them with ray noise as the evaluation's filter leaves it."""

import numpy as np
from scipy.ndimage import gaussian_filter

from lensforge.scene.pixel_grid import gaussian3

REPLICATES = 16


def bumpy(side: int, deviation: float, seed: int = 0) -> np.ndarray:
    """A flat top with smooth random bumps, 6 pixels wide, of relative standard deviation ``deviation``."""
    bumps = gaussian_filter(np.random.default_rng(seed).normal(size=(side, side)), 6.0, mode="wrap")
    return 1.0 + deviation * bumps / bumps.std()


def noisy(
    truth: np.ndarray, noise: float, rng: np.random.Generator, replicates: int = REPLICATES, filtered: bool = True
) -> np.ndarray:
    """Replicates whose mean has noise of standard deviation ``noise`` in each pixel, neighbours correlated."""
    white = rng.normal(size=(replicates, *truth.shape))
    if filtered:
        point = np.zeros((5, 5))
        point[2, 2] = 1.0
        kept = np.linalg.norm(gaussian3(point, 1.0))
        white = np.stack([gaussian3(image, 1.0) for image in white]) / kept
    return truth + noise * np.sqrt(replicates) * white
