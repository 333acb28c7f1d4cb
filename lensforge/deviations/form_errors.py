"""Form errors of a face as tables: prepared once, then added to the table of the face with the numbers of each part.

A field is a sum of tables with independent Gaussian numbers, whose mean square over the hemisphere and over the parts
is 1 mm^2 along the normal. Radii add linearly: an error e along the normal is taken as one along the radius of e over
the cosine between the two, which neglects terms of e times its own slope (1e-6 of it at a micrometre).

Waviness has the spectral density k^-b between two wavelengths: a mixture of Gaussian low-pass fields, each half as wide
as the one before, of width s (correlation exp(-r^2 / 2 s^2)) and variance proportional to s^(b - 2). What is too narrow
for the tables counts as roughness, by the rms slope it has, the same in every direction.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.deviations.factors import FORM_NUMBERS, WAVINESS_NUMBERS
from lensforge.surfaces.spline import TableGrid
from lensforge.surfaces.srbf import MOST_FUNCTIONS, SrbfBasis, fibonacci_hemisphere, level_sigma
from lensforge.surfaces.surface import Surface
from lensforge.surfaces.weight_maps import weight_maps

# Width of a low-pass field over the wavelength where its density has fallen to 1/e: exp(-k^2 s^2 / 2), k = 2 pi / l.
_WIDTH = float(np.sqrt(2.0) / (2.0 * np.pi))
_SIGMA_C = 1.75  # of the sums of basis functions: neighbours overlap, the sum shows no grid
_NODES_PER_SIGMA = 2.0  # of a table: its spline is then within 2 % of the field (tests/deviations/test_form_errors.py)
_SAMPLES = 4000


@dataclass(frozen=True, eq=False)
class FormError:
    """One field: ``tables`` (k, side, side) in mm per unit number, and the ``slope`` (per mm of its rms, along any
    line) of what is too fine for them.
    """

    tables: Float[np.ndarray, "k side side"]
    slope: float = 0.0


def low_order(grid: TableGrid, surface: Surface) -> FormError:
    """Broad errors of a face: ``FORM_NUMBERS`` basis functions over the hemisphere."""
    basis = SrbfBasis((FORM_NUMBERS,), _SIGMA_C)
    return FormError(_normalised(_tables(grid, basis, np.eye(FORM_NUMBERS)), _along_normal(basis, surface)))


def _along_normal(basis: SrbfBasis, surface: Surface) -> Float[np.ndarray, "n m"]:
    """Values of each function along the normal over the hemisphere."""
    u = fibonacci_hemisphere(_SAMPLES)
    cosine = np.sum(surface.normal(u) * u, axis=1)
    found: Float[np.ndarray, "n m"] = basis.evaluate(u) * cosine[:, None]
    return found


def _normalised(
    tables: Float[np.ndarray, "k side side"], values: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "k side side"]:
    """``tables`` scaled so that with independent numbers the mean square of ``values`` is 1."""
    scaled: Float[np.ndarray, "k side side"] = tables / np.sqrt(np.mean(np.sum(values**2, axis=1)))
    return scaled


def waviness(
    grid: TableGrid, surface: Surface, shortest_mm: float, longest_mm: float, exponent: float, seed: int
) -> FormError:
    """Errors of a face with wavelengths between two: sums of ``WAVINESS_NUMBERS`` random fields of the spectrum."""
    radius_mm = float(surface.radius(fibonacci_hemisphere(_SAMPLES)).mean())
    octaves = max(1, round(float(np.log2(longest_mm / shortest_mm))))
    widths_mm = _WIDTH * longest_mm * (shortest_mm / longest_mm) ** ((np.arange(octaves) + 0.5) / octaves)
    variances = widths_mm ** (exponent - 2.0)
    variances /= variances.sum()
    counts = [_functions(width / radius_mm) for width in widths_mm]
    coarse = np.array([_fits(grid, count) for count in counts])
    slope = float(np.sqrt(np.sum((variances / widths_mm**2)[~coarse])))
    tables = np.zeros((WAVINESS_NUMBERS, grid.side, grid.side))
    rng = np.random.default_rng(seed)
    u = fibonacci_hemisphere(_SAMPLES)
    cosine = np.sum(surface.normal(u) * u, axis=1)
    for count, variance in zip(np.array(counts)[coarse], variances[coarse], strict=True):
        basis = SrbfBasis((int(count),), _SIGMA_C)
        weights = rng.standard_normal((int(count), WAVINESS_NUMBERS))
        spread = np.sqrt(np.mean(np.sum(basis.evaluate(u) ** 2, axis=1) * cosine**2))
        tables += _tables(grid, basis, weights) * (np.sqrt(variance / WAVINESS_NUMBERS) / spread)
    return FormError(tables, slope)


def _functions(width_rad: float) -> int:
    """Number of basis functions over the hemisphere whose random sum has that width."""
    return int(np.ceil(1.0 / (1.0 - np.cos(min(width_rad / _SIGMA_C, 1.0)))))


def _fits(grid: TableGrid, count: int) -> bool:
    """True where the table resolves ``count`` functions: at the apex its step is 2 rad per unit of the chart."""
    return count <= MOST_FUNCTIONS and level_sigma(count, _SIGMA_C) >= _NODES_PER_SIGMA * 2.0 * grid.step


def ripple(grid: TableGrid, surface: Surface, period_mm: float) -> FormError:
    """Rings about the axis, peak to valley 1 mm: one table, or their slope where they are too fine for one.

    A ring's slope lies across it alone; as roughness it counts half along every line.
    """
    u = grid.sample_directions()
    radius = surface.radius(u)
    if period_mm < 4.0 * 2.0 * grid.step * float(radius.max()):
        return FormError(np.zeros((0, grid.side, grid.side)), 0.5 * np.pi / period_mm)
    phase = 2.0 * np.pi / period_mm * radius * np.hypot(u[:, 0], u[:, 1])
    rings = 0.5 * np.cos(phase) / np.sum(surface.normal(u) * u, axis=1)
    return FormError(grid.coefficients(rings[:, None]).reshape(1, grid.side, grid.side))


def _tables(
    grid: TableGrid, basis: SrbfBasis, weights: Float[np.ndarray, "m c"]
) -> Float[np.ndarray, "c side side"]:
    """Tables of ``c`` sums over one level of basis functions."""
    (level,) = weight_maps(grid, basis)
    side, nodes = level.refine.shape
    columns = weights.shape[1]
    samples = (level.samples @ weights).reshape(nodes, -1)
    along_x = (level.refine @ samples).reshape(side, nodes, columns)
    along_y = level.refine @ along_x.transpose(1, 0, 2).reshape(nodes, -1)
    return np.ascontiguousarray(along_y.reshape(side, side, columns).transpose(2, 1, 0))
