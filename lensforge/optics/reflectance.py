"""Reflectance of a coated face by wavelength and by the cosine in its less dense medium, as the design takes it.

Beside it stands its excess: what s reflects more than p, over the squared sine, which is smooth at normal incidence. A
table, which states no polarisation, has none.

A face that absorbs nothing reflects as much from either side of it, at angles that belong together by Snell's law. Over
that cosine reflectance is smooth from normal to grazing incidence; over the angle in the denser medium it is not.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.optics.media import Coating, LayerStack, ReflectanceTable

Waves = Float[np.ndarray, " k"]
Cosines = Float[np.ndarray, " m"]
Reflectances = Float[np.ndarray, "k m"]
Pairs = Float[np.ndarray, "k m 2"]  # reflectance, and its excess

_ERROR = 1e-5  # of a stack between two wavelengths of its table
_LEAST_ROWS, _MOST_ROWS = 16, 4096  # of them, less one
_SOME = np.linspace(0.25, 1.0, 13)  # cosines at which that error is found: up to 75 degrees
_ALL = np.linspace(0.0, 1.0, 65)  # at which the least reflectance is; between them it may be less by _LOWER
_LOWER = 1e-4
_NORMAL = 1.0 - 1e-6  # cosine beyond which the excess is as there
_PER_FRINGE, _MOST_SAMPLES = 80, 20_000  # wavelengths at which the least of a stack over all of its range is found


@dataclass(frozen=True)
class Reflectance:
    """Reflectance [wavelength, cosine]; linear between ``nodes_nm``, which are none where no wavelength counts.

    ``least``: at the wavelengths for which it was made, no larger than 1 less the root mean square of what s and p
    transmit: two such faces in one plane transmit no more than the product of these (Cauchy and Schwarz).
    """

    at: Callable[[Waves, Cosines], Pairs]
    nodes_nm: Waves
    least: float


def reflectance_of(coating: Coating, around: float, span_nm: tuple[float, float]) -> Reflectance:
    """Reflectance of a face between ``around``, the index of what surrounds the body, and the body, over ``span_nm``.

    Raises :class:`InputError` for layers too thick for a table.
    """
    return _of_table(coating) if isinstance(coating, ReflectanceTable) else _of_stack(coating, around, span_nm)


def _of_table(table: ReflectanceTable) -> Reflectance:
    from scipy.interpolate import PchipInterpolator

    angles, values = np.array(table.angles_deg), np.array(table.reflectance)
    if angles[-1] < 90.0:  # at grazing incidence every face reflects all light
        angles, values = np.append(angles, 90.0), np.column_stack([values, np.ones(len(values))])
    cosines = np.where(angles < 90.0, np.cos(np.radians(angles)), 0.0)
    curves, nodes = PchipInterpolator(cosines[::-1], values[:, ::-1], axis=1), np.array(table.wavelengths_nm)

    def at(waves: Waves, cosines: Cosines) -> Pairs:
        rows: Reflectances = curves(cosines)
        if len(rows) == 1:
            found = np.repeat(rows, len(waves), axis=0)
        else:
            place = np.interp(waves, nodes, np.arange(len(nodes)))
            low = np.minimum(place.astype(int), len(nodes) - 2)
            found = rows[low] + (place - low)[:, None] * (rows[low + 1] - rows[low])
        return np.stack([found, np.zeros_like(found)], axis=-1)

    return Reflectance(at, nodes, float(values.min()))  # a monotone cubic stays within its values


def _of_stack(stack: LayerStack, around: float, span_nm: tuple[float, float]) -> Reflectance:
    low, high = np.clip(span_nm, *stack.range_nm)

    def at(waves: Waves, cosines: Cosines) -> Pairs:
        waves = np.clip(waves, low, high)
        across, along = stack_reflectances(stack, around, waves, cosines)
        oblique = np.minimum(cosines, _NORMAL)
        across_there, along_there = stack_reflectances(stack, around, waves, oblique)
        excess = (across_there - along_there) / (1.0 - oblique**2)
        return np.stack([0.5 * (across + along), excess], axis=-1)

    nodes = _nodes(at, float(low), float(high))
    return Reflectance(at, nodes, _least_of_stack(stack, around, np.clip(nodes, low, high)))


def _least_of_stack(stack: LayerStack, around: float, waves: Waves) -> float:
    passed = 1.0 - np.stack(stack_reflectances(stack, around, waves, _ALL))
    return max(1.0 - float(np.sqrt(np.mean(passed**2, axis=0)).max()) - _LOWER, 0.0)


def least_reflectance(coating: Coating, around: float) -> float:
    """Lower bound of the reflectance at any angle and wavelength; 0 where a thick stack has too many fringes."""
    if isinstance(coating, ReflectanceTable):
        return min(map(min, coating.reflectance))
    low, high = coating.range_nm
    path_nm = sum(layer.thickness_nm * max(layer.index.refractive_index) for layer in coating.layers)
    count = _LEAST_ROWS + int(2.0 * _PER_FRINGE * path_nm * (1.0 / low - 1.0 / high))
    if count > _MOST_SAMPLES:
        return 0.0
    return _least_of_stack(coating, around, 1.0 / np.linspace(1.0 / high, 1.0 / low, count))


def _nodes(at: Callable[[Waves, Cosines], Pairs], low: float, high: float) -> Waves:
    """Wavelengths (nm) at equal steps between which reflectance is linear but for the error allowed."""
    rows = _LEAST_ROWS
    while low < high and rows <= _MOST_ROWS:
        waves = np.linspace(low, high, 2 * rows + 1)
        found = at(waves, _SOME)
        if np.abs(found[1::2] - 0.5 * (found[:-1:2] + found[2::2])).max() < _ERROR:
            return waves[::2]
        rows *= 2
    if low < high:
        raise InputError(
            f"lens: a coating whose layers are too thick: more than {_MOST_ROWS} wavelengths would be needed between "
            f"{low:g} and {high:g} nm; give its reflectance as a table"
        )
    return np.array([low])


def stack_reflectances(
    stack: LayerStack, around: float, waves: Waves, cosines: Cosines
) -> tuple[Reflectances, Reflectances]:
    """Reflectances of s and of p by the characteristic matrices of the layers (Born and Wolf, 1.6).

    ``waves``: nm; ``cosines``: in the less dense of both media.
    """
    body, number = stack.body.at(waves)[:, None], 2.0 * np.pi / waves[:, None]
    ends = np.full_like(body, around), body
    invariant = (np.minimum(*ends) ** 2) * (1.0 - cosines**2)  # (n sin)^2 of the angle, the same in every layer
    found: list[Reflectances] = []
    for power in (0, 2):  # s and p: the admittance of a wave is n cos over n^power
        first, last = (np.sqrt(index**2 - invariant) / index**power for index in ends)
        a, b, c, d = np.ones_like(first), np.zeros_like(first), np.zeros_like(first), np.ones_like(first)
        for layer in stack.layers:  # matrices [[a, -i b], [-i c, d]]
            index, thick = layer.index.at(waves)[:, None], number * layer.thickness_nm
            squared = index**2 - invariant
            cosine, sine = _waves(squared * thick**2)
            up, down = sine * thick * index**power, sine * thick * squared / index**power
            a, b, c, d = a * cosine - b * down, a * up + b * cosine, c * cosine + d * down, d * cosine - c * up
        real, imaginary, both = a * first, b * first * last + c, d * last
        less = (real - both) ** 2 + (b * first * last - c) ** 2
        found.append(less / ((real + both) ** 2 + imaginary**2))
    return found[0], found[1]


def _waves(squared: Reflectances) -> tuple[Reflectances, Reflectances]:
    """cos x and sin x / x of the phases x of which the squares are given; below 0 the wave is evanescent."""
    phase = np.sqrt(np.maximum(squared, 0.0))
    cosine, sine = np.cos(phase), np.sinc(phase / np.pi)
    evanescent = squared < 0.0
    if evanescent.any():
        depth = np.sqrt(np.maximum(-squared, 1e-16))
        cosine = np.where(evanescent, np.cosh(depth), cosine)
        sine = np.where(evanescent, np.sinh(depth) / depth, sine)
    return cosine, sine
