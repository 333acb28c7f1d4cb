"""Reflectance of coated faces, and its tables as the tracers of the design take them.

Reflectance is by wavelength and by the cosine in the less dense medium. Beside it stands its excess: what s reflects
more than p, over the squared sine, which is smooth at normal incidence. A coating given as a table, which states no
polarisation, has none. A face that absorbs nothing reflects as much from either side of it, at angles that belong
together by Snell's law. Over that cosine reflectance is smooth from normal to grazing incidence; over the angle in the
denser medium it is not.

A row of a tracer's table holds the coefficients of uniform cubic B-splines over the cosine, from 0 to 1; between rows,
one for each of ``wavelengths_nm``, reflectance and excess are linear.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.optics.media import Film, LayerStack, Media, Mirror, ReflectanceTable

Waves = Float[np.ndarray, " k"]
Cosines = Float[np.ndarray, " m"]
Reflectances = Float[np.ndarray, "k m"]
Pairs = Float[np.ndarray, "k m 2"]  # reflectance, and its excess

_ERROR = 1e-5  # of a stack between two wavelengths of its table
_LEAST_ROWS = 16
_MOST_ROWS = 4096
_SOME = np.linspace(0.25, 1.0, 13)  # cosines at which that error is found: up to 75 degrees
_ALL = np.linspace(0.0, 1.0, 65)  # at which the least reflectance is; between them it may be less by _LOWER
_LOWER = 1e-4
_NORMAL = 1.0 - 1e-6  # cosine beyond which the excess is as there
# Wavelengths at which the least reflectance of a stack over its range is searched for.
_PER_FRINGE = 80
_MOST_SAMPLES = 20_000


@dataclass(frozen=True)
class Reflectance:
    """Reflectance [wavelength, cosine]; linear between ``nodes_nm``, empty if independent of wavelength.

    ``least``: at its wavelengths, at most 1 less the root mean square of the transmittances of s and p: two such faces
    in one plane transmit no more than the product of these (Cauchy and Schwarz).
    """

    at: Callable[[Waves, Cosines], Pairs]
    nodes_nm: Waves
    least: float


@lru_cache(maxsize=64)
def reflectance_of(coating: Film, around: float, span_nm: tuple[float, float]) -> Reflectance:
    """Reflectance of a face between the index ``around`` the body and the body, over ``span_nm``.

    Raises :class:`InputError` for layers too thick for a table.
    """
    return _of_table(coating) if isinstance(coating, ReflectanceTable) else _of_stack(coating, around, span_nm)


def _of_table(table: ReflectanceTable) -> Reflectance:
    from scipy.interpolate import PchipInterpolator

    angles = np.array(table.angles_deg)
    values = np.array(table.reflectance)
    if angles[-1] < 90.0:  # at grazing incidence every face reflects all light
        angles = np.append(angles, 90.0)
        values = np.column_stack([values, np.ones(len(values))])
    cosines = np.where(angles < 90.0, np.cos(np.radians(angles)), 0.0)
    curves = PchipInterpolator(cosines[::-1], values[:, ::-1], axis=1)
    nodes = np.array(table.wavelengths_nm)

    def at(waves: Waves, cosines: Cosines) -> Pairs:
        rows: Reflectances = curves(cosines)
        if len(rows) == 1:
            values = np.repeat(rows, len(waves), axis=0)
        else:
            place = np.interp(waves, nodes, np.arange(len(nodes)))
            low = np.minimum(place.astype(int), len(nodes) - 2)
            values = rows[low] + (place - low)[:, None] * (rows[low + 1] - rows[low])
        return np.stack([values, np.zeros_like(values)], axis=-1)

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


@lru_cache(maxsize=64)
def least_reflectance(coating: Film, around: float) -> float:
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
    """Evenly spaced wavelengths (nm) between which reflectance is linear to the permitted error."""
    rows = _LEAST_ROWS
    while low < high and rows <= _MOST_ROWS:
        waves = np.linspace(low, high, 2 * rows + 1)
        pairs = at(waves, _SOME)
        if np.abs(pairs[1::2] - 0.5 * (pairs[:-1:2] + pairs[2::2])).max() < _ERROR:
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
    body = stack.body.at(waves)[:, None]
    number = 2.0 * np.pi / waves[:, None]
    ends = np.full_like(body, around), body
    invariant = (np.minimum(*ends) ** 2) * (1.0 - cosines**2)  # (n sin)^2 of the angle, the same in every layer
    reflectances: list[Reflectances] = []
    for power in (0, 2):  # s and p: the admittance of a wave is n cos over n^power
        first, last = (np.sqrt(index**2 - invariant) / index**power for index in ends)
        a = np.ones_like(first)
        b = np.zeros_like(first)
        c = np.zeros_like(first)
        d = np.ones_like(first)
        for layer in stack.layers:  # matrices [[a, -i b], [-i c, d]]
            index = layer.index.at(waves)[:, None]
            thick = number * layer.thickness_nm
            squared = index**2 - invariant
            cosine, sine = _waves(squared * thick**2)
            up = sine * thick * index**power
            down = sine * thick * squared / index**power
            a, b, c, d = a * cosine - b * down, a * up + b * cosine, c * cosine + d * down, d * cosine - c * up
        real = a * first
        imaginary = b * first * last + c
        both = d * last
        less = (real - both) ** 2 + (b * first * last - c) ** 2
        reflectances.append(less / ((real + both) ** 2 + imaginary**2))
    return reflectances[0], reflectances[1]


def _waves(squared: Reflectances) -> tuple[Reflectances, Reflectances]:
    """cos x and sin x / x of phases x, from their squares; for negative squares the wave is evanescent."""
    phase = np.sqrt(np.maximum(squared, 0.0))
    cosine = np.cos(phase)
    sine = np.sinc(phase / np.pi)
    evanescent = squared < 0.0
    if evanescent.any():
        depth = np.sqrt(np.maximum(-squared, 1e-16))
        cosine = np.where(evanescent, np.cosh(depth), cosine)
        sine = np.where(evanescent, np.sinh(depth) / depth, sine)
    return cosine, sine


GLASS = "glass"  # name of the faces of the cover glass: a face of a lens has another
Table = Float[np.ndarray, "k m 2"]
Span = tuple[float, float]  # least and largest wavelength (nm)

_TABLE_ERROR = 3e-6  # of the splines, between their nodes
_LEAST_CELLS = 32
_MOST_CELLS = 1024
_GRAZING = 0.1  # cosine below which that error does not count: 6 degrees, at which no face is lit
_PROBED = 9  # rows at which it is found
_WHOLE_NM = 50.0  # the ends of a span are moved out to multiples, so that samples of a source share their tables


@dataclass(frozen=True, eq=False)
class CoatingTables:
    """Reflectance of the coated faces by name; all with the same rows."""

    wavelengths_nm: Float[np.ndarray, " k"]
    faces: dict[str, Table]


@dataclass(frozen=True)
class CoatedFace:
    """A coating, and the index around the body that carries it."""

    coating: Film
    around: float

    def reflectance(self, span_nm: Span) -> Reflectance:
        """Reflectance over a span of wavelengths."""
        return reflectance_of(self.coating, self.around, span_nm)

    @property
    def known_nm(self) -> Span | None:
        """Wavelengths at which its reflectance is known; None: at all."""
        if not isinstance(self.coating, ReflectanceTable):
            return self.coating.range_nm
        waves = self.coating.wavelengths_nm
        return (waves[0], waves[-1]) if waves else None


def coated_faces(media: Media) -> dict[str, CoatedFace]:
    """The faces with a film by name, both of the cover glass last, as GLASS; mirrors are not among them."""
    faces = {
        coating.face: CoatedFace(coating.coating, media.around(coating.around))
        for coating in media.coatings
        if not isinstance(coating.coating, Mirror)
    }
    glass = media.cover_glass
    if glass is not None and glass.coating is not None:
        faces[GLASS] = CoatedFace(glass.coating, media.outside_index)
    return faces


def whole_span(wavelengths_nm: Float[np.ndarray, " n"] | None, media: Media) -> Span:
    """Slightly widened span of wavelengths; for light without wavelengths the one at which ``media`` are given."""
    if wavelengths_nm is None or len(wavelengths_nm) == 0:
        return media.wavelength_nm, media.wavelength_nm
    low = float(wavelengths_nm.min())
    high = float(wavelengths_nm.max())
    return max(np.floor(low / _WHOLE_NM), 0.1) * _WHOLE_NM, np.ceil(high / _WHOLE_NM) * _WHOLE_NM


@lru_cache(maxsize=16)
def coating_tables(media: Media, span_nm: Span) -> CoatingTables:
    """Tables for light of ``span_nm``: of one row for a single wavelength, or if none counts.

    Raises :class:`InputError` for layers too thick for a table.
    """
    curves = {name: face.reflectance(span_nm) for name, face in coated_faces(media).items()}
    nodes = np.unique(np.concatenate([curve.nodes_nm for curve in curves.values()]))
    single = span_nm[0] == span_nm[1] or len(nodes) == 0
    waves = np.array(span_nm[:1]) if single else nodes
    return CoatingTables(waves, {name: _coefficients(curve, waves) for name, curve in curves.items()})


def least_reflectances(media: Media, span_nm: Span | None) -> dict[str, float]:
    """Lower bound of the reflectance of each coated face, at any angle.

    If s and p differ, of 1 less the root mean square of their transmittances.

    ``span_nm`` None: for light of any wavelengths.
    """
    return {
        name: least_reflectance(face.coating, face.around) if span_nm is None else face.reflectance(span_nm).least
        for name, face in coated_faces(media).items()
    }


def _coefficients(face: Reflectance, waves: Float[np.ndarray, " k"]) -> Table:
    """Spline coefficients of the reflectance, on as few equal cells as its error allows."""
    cells = _LEAST_CELLS
    probed = waves[np.unique(np.linspace(0, len(waves) - 1, _PROBED).astype(int))]
    while cells < _MOST_CELLS:
        middles = (np.arange(cells) + 0.5) / cells
        table = _interpolating(face.at(probed, np.linspace(0.0, 1.0, cells + 1)))
        splines = (table[:, :-3] + 23.0 * table[:, 1:-2] + 23.0 * table[:, 2:-1] + table[:, 3:]) / 48.0
        error = np.abs(splines - face.at(probed, middles))[:, middles > _GRAZING]
        if error.max() < _TABLE_ERROR:
            break
        cells *= 2
    return _interpolating(face.at(waves, np.linspace(0.0, 1.0, cells + 1)))


def _interpolating(values: Float[np.ndarray, "k c 2"]) -> Table:
    """Coefficients of the cubic B-splines through values at equal steps, two more; the ends are not knots."""
    count = values.shape[1]
    matrix = np.zeros((count + 2, count + 2))
    for offset, weight in enumerate((1.0, 4.0, 1.0)):
        matrix[np.arange(1, count + 1), np.arange(count) + offset] = weight / 6.0
    matrix[0, :5] = matrix[-1, -5:] = (1.0, -4.0, 6.0, -4.0, 1.0)
    known = np.pad(values, ((0, 0), (1, 1), (0, 0)))
    return np.ascontiguousarray(np.einsum("ij,kjp->kip", np.linalg.inv(matrix), known))
