"""Amplitudes of polarised light in total reflection, against Fresnel's formulas in complex numbers."""

import numpy as np
import pytest

from lensforge.kernels.fields import reflecting


def amplitudes(c: float, ratio: float) -> tuple[complex, complex]:
    """``a_s``, and what ``a_p`` has more of it over the squared sine, at the cosine ``c`` and the ratio of indices."""
    evanescent = 1j * np.sqrt(ratio**2 * (1.0 - c**2) - 1.0)
    across = (ratio * c - evanescent) / (ratio * c + evanescent)
    along = -(c - ratio * evanescent) / (c + ratio * evanescent)
    return across, (along - across) / (1.0 - c**2)


@pytest.mark.parametrize("ratio", [1.2, 1.49, 1.8])
@pytest.mark.parametrize("share", [0.1, 0.6, 0.95])
def test_total_reflection_has_the_amplitudes_of_fresnel_and_their_slopes(ratio: float, share: float) -> None:
    c = share * float(np.sqrt(1.0 - 1.0 / ratio**2))  # of the cosine at the limit of total reflection
    step = 1e-6
    ends = [np.array(amplitudes(c + sign * step, ratio)) for sign in (1.0, -1.0)]
    a, k, by_a, by_k = (complex(*parts) for parts in reflecting.py_func(c, ratio))
    np.testing.assert_allclose([a, k], amplitudes(c, ratio), rtol=1e-12)
    np.testing.assert_allclose([by_a, by_k], (ends[0] - ends[1]) / (2.0 * step), rtol=1e-7)
