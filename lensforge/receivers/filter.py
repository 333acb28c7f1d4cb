"""The paper's evaluation filter: a 3 x 3 Gaussian of stated variance (in pixels squared)."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import convolve1d


def gaussian3(image: Float[np.ndarray, "p p"], variance: float) -> Float[np.ndarray, "p p"]:
    """Convolve with the normalised 3 x 3 Gaussian; edge pixels are repeated outwards. Variance 0: unchanged."""
    if variance == 0.0:
        return image
    side = float(np.exp(-0.5 / variance))
    taps = np.array([side, 1.0, side]) / (1.0 + 2.0 * side)
    smoothed = convolve1d(convolve1d(image, taps, axis=0, mode="nearest"), taps, axis=1, mode="nearest")
    return np.asarray(smoothed, dtype=np.float64)
