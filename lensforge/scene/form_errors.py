"""Form errors of a face as tables: prepared once, then added to the table of the face with the numbers of each part.

A field is a sum of tables with independent Gaussian numbers, whose mean square over the hemisphere and over the parts
is 1 mm^2 along the normal. Radii add linearly: an error e along the normal is taken as one along the radius of e over
the cosine between the two, which neglects terms of e times its own slope (1e-6 of it at a micrometre).

Waviness has the spectral density k^-b between two wavelengths: a mixture of Gaussian low-pass fields of widths s
(correlation exp(-r^2 / 2 s^2) over the chord r) with variances proportional to s^(b - 2). A sum of waves in space with
normally distributed wave vectors, read on the face, is such a field (Rahimi and Recht, Random features, 2007). What is
too narrow for the tables counts as roughness, by the rms slope it has, the same along every line.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.scene.tolerance_factors import FORM_NUMBERS, WAVINESS_NUMBERS
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.srbf import SrbfBasis, fibonacci_hemisphere
from lensforge.surfaces.surface import Surface

# Width of a low-pass field over the wavelength where its density has fallen to 1/e: exp(-k^2 s^2 / 2), k = 2 pi / l.
_WIDTH = float(np.sqrt(2.0) / (2.0 * np.pi))
_SIGMA_C = 1.75  # of the broad functions: neighbours overlap
_NODES_PER_WIDTH = 2.0  # of a table: its spline is then within 1 % of the field (tests/scene/test_form_errors.py)
_NODES_PER_PERIOD = 8.0  # of rings, whose spline is then within 1 %, too
_WAVES = 384  # of a field: its values are then normal within 1 %, and its spectrum smooth
_SAMPLES = 4000


@dataclass(frozen=True, eq=False)
class ErrorField:
    """One field: ``tables`` (k, side, side) in mm per unit number, and the ``slope`` (per mm of its rms, along any
    line) of what is too fine for them.
    """

    tables: Float[np.ndarray, "k side side"]
    slope: float = 0.0


@dataclass(frozen=True, eq=False)
class FaceNodes:
    """A face at the nodes of a grid: points (mm), and cosines between normal and radius, to 1e-3 by differences."""

    grid: TableGrid
    directions: Float[np.ndarray, "k 3"]
    points: Float[np.ndarray, "k 3"]
    cosines: Float[np.ndarray, " k"]

    @staticmethod
    def of(grid: TableGrid, surface: Surface) -> "FaceNodes":
        """Sample ``surface``."""
        u = grid.sample_directions()
        count = round(np.sqrt(len(u)))
        radius = surface.radius_on_grid(u.reshape(count, count, 3))
        # on the sphere the chart is smaller by its conformal factor, 2 / (1 + R^2) = 1 + z
        slope = np.hypot(*np.gradient(radius, grid.step)) / (1.0 + u[:, 2].reshape(count, count))
        cosines = 1.0 / np.sqrt(1.0 + (slope / radius) ** 2)
        return FaceNodes(grid, u, radius.reshape(-1, 1) * u, cosines.reshape(-1))

    @property
    def most_mm(self) -> float:
        """Largest radius."""
        return float(np.linalg.norm(self.points, axis=1).max())

    def table(self, fields: Float[np.ndarray, "k c"], slope: float = 0.0) -> ErrorField:
        """The form error with these fields (mm) along the normal."""
        grid = self.grid
        coefficients = grid.coefficients(fields / self.cosines[:, None])
        return ErrorField(np.ascontiguousarray(coefficients.T).reshape(-1, grid.side, grid.side), slope)

    def none(self, slope: float) -> ErrorField:
        """The form error of which the tables hold nothing."""
        return ErrorField(np.zeros((0, self.grid.side, self.grid.side)), slope)


def low_order(face: FaceNodes) -> ErrorField:
    """Broad errors of a face: ``FORM_NUMBERS`` basis functions over the hemisphere."""
    basis = SrbfBasis((FORM_NUMBERS,), _SIGMA_C)
    square = np.sum(basis.evaluate(fibonacci_hemisphere(_SAMPLES)) ** 2, axis=1).mean()
    return face.table(basis.evaluate(face.directions) / np.sqrt(square))


def waviness(face: FaceNodes, shortest_mm: float, longest_mm: float, exponent: float, seed: int) -> ErrorField:
    """Errors of a face with wavelengths between two: ``WAVINESS_NUMBERS`` random fields of the spectrum."""
    places = (np.arange(_WAVES) + 0.5) / _WAVES
    widths_mm = _WIDTH * longest_mm * (shortest_mm / longest_mm) ** places
    variances = widths_mm ** (exponent - 2.0)
    variances /= variances.sum()
    fits = widths_mm >= _NODES_PER_WIDTH * 2.0 * face.grid.step * face.most_mm  # a step is 2 rad wide at the apex
    slope = float(np.sqrt(np.sum((variances / widths_mm**2)[~fits])))
    rng = np.random.default_rng(seed)
    vectors = rng.standard_normal((_WAVES, 3)) / widths_mm[:, None]
    numbers = rng.standard_normal((2, _WAVES, WAVINESS_NUMBERS)) * np.sqrt(variances / WAVINESS_NUMBERS)[:, None]
    if not fits.any():
        return face.none(slope)
    phases = face.points @ vectors[fits].T
    return face.table(np.cos(phases) @ numbers[0, fits] + np.sin(phases) @ numbers[1, fits], slope)


def ripple(face: FaceNodes, period_mm: float) -> ErrorField:
    """Rings about the axis, peak to valley 1 mm: one table, or their slope where they are too fine for one.

    A ring's slope lies across it alone; as roughness it counts half along every line.
    """
    if period_mm < _NODES_PER_PERIOD * 2.0 * face.grid.step * face.most_mm:
        return face.none(0.5 * np.pi / period_mm)
    phase = 2.0 * np.pi / period_mm * np.hypot(face.points[:, 0], face.points[:, 1])
    return face.table(0.5 * np.cos(phase)[:, None])
