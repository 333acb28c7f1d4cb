"""Tables of the coated faces of a lens, as the tracers of the design take them.

A row holds the coefficients of uniform cubic B-splines over the cosine in the less dense medium, from 0 to 1, of the
reflectance and of its excess, see ``optics.reflectance``; between rows, one for each of ``wavelengths_nm``, both are
linear.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from lensforge.optics.media import Coating, Media, ReflectanceTable
from lensforge.optics.reflectance import Reflectance, least_reflectance, reflectance_of

Table = Float[np.ndarray, "k m 2"]
Span = tuple[float, float]  # least and largest wavelength (nm)

_ERROR = 3e-6  # of the splines, between their nodes
_LEAST_CELLS, _MOST_CELLS = 32, 1024
_GRAZING = 0.1  # cosine below which that error does not count: 6 degrees, at which no face is lit
_PROBED = 9  # rows at which it is found
_WHOLE_NM = 50.0  # the ends of a span are moved out to multiples, so that samples of a source share their tables


@dataclass(frozen=True, eq=False)
class CoatingTables:
    """Reflectance of the faces that are coated; the same rows in each."""

    wavelengths_nm: Float[np.ndarray, " k"]
    inner: Float[np.ndarray, "k a 2"] | None
    outer: Float[np.ndarray, "k b 2"] | None
    glass: Float[np.ndarray, "k c 2"] | None


@dataclass(frozen=True)
class CoatedFace:
    """A coating, and the index of what surrounds the body that carries it."""

    coating: Coating
    around: float

    def reflectance(self, span_nm: Span) -> Reflectance:
        """Reflectance over a span of wavelengths."""
        return _reflectance(self.coating, self.around, span_nm)

    @property
    def known_nm(self) -> Span | None:
        """Wavelengths at which its reflectance is known; None: at all."""
        if not isinstance(self.coating, ReflectanceTable):
            return self.coating.range_nm
        waves = self.coating.wavelengths_nm
        return (waves[0], waves[-1]) if waves else None


_least_anywhere = lru_cache(maxsize=64)(least_reflectance)


@lru_cache(maxsize=64)
def _reflectance(coating: Coating, around: float, span_nm: Span) -> Reflectance:
    return reflectance_of(coating, around, span_nm)


def coated_faces(media: Media) -> dict[str, CoatedFace]:
    """The coated faces by name: inner, outer, glass."""
    glass = media.cover_glass
    each = {
        "inner": (media.inner_coating, media.cavity_index),
        "outer": (media.outer_coating, media.outside_index),
        "glass": (None if glass is None else glass.coating, media.outside_index),
    }
    return {name: CoatedFace(coating, around) for name, (coating, around) in each.items() if coating is not None}


def whole_span(wavelengths_nm: Float[np.ndarray, " n"] | None, media: Media) -> Span:
    """Span of some light, a little wider; of light without wavelengths that one at which ``media`` are given."""
    if wavelengths_nm is None or len(wavelengths_nm) == 0:
        return media.wavelength_nm, media.wavelength_nm
    low, high = float(wavelengths_nm.min()), float(wavelengths_nm.max())
    return max(np.floor(low / _WHOLE_NM), 0.1) * _WHOLE_NM, np.ceil(high / _WHOLE_NM) * _WHOLE_NM


@lru_cache(maxsize=16)
def coating_tables(media: Media, span_nm: Span) -> CoatingTables:
    """Tables for light of ``span_nm``: of one row where that is one wavelength, or where none counts.

    Raises :class:`InputError` for layers too thick for a table.
    """
    found = {name: face.reflectance(span_nm) for name, face in coated_faces(media).items()}
    nodes = np.unique(np.concatenate([each.nodes_nm for each in found.values()]))
    single = span_nm[0] == span_nm[1] or len(nodes) == 0
    waves = np.array(span_nm[:1]) if single else nodes
    tables = {name: _coefficients(each, waves) for name, each in found.items()}
    return CoatingTables(waves, *(tables.get(name) for name in ("inner", "outer", "glass")))


def least_reflectances(media: Media, span_nm: Span | None) -> tuple[float | None, float | None]:
    """Lower bounds of the reflectance of the inner and the outer face, at any angle; None: the face is not coated.

    Where s and p differ, of 1 less the root mean square of what they transmit.

    ``span_nm`` None: for light of any wavelengths.
    """
    faces = coated_faces(media)

    def least(face: CoatedFace | None) -> float | None:
        if face is None:
            return None
        return _least_anywhere(face.coating, face.around) if span_nm is None else face.reflectance(span_nm).least

    return least(faces.get("inner")), least(faces.get("outer"))


def _coefficients(face: Reflectance, waves: Float[np.ndarray, " k"]) -> Table:
    """Coefficients of splines through the reflectance, on as few equal cells as its error allows."""
    cells = _LEAST_CELLS
    probed = waves[np.unique(np.linspace(0, len(waves) - 1, _PROBED).astype(int))]
    while cells < _MOST_CELLS:
        middles = (np.arange(cells) + 0.5) / cells
        table = _interpolating(face.at(probed, np.linspace(0.0, 1.0, cells + 1)))
        splines = (table[:, :-3] + 23.0 * table[:, 1:-2] + 23.0 * table[:, 2:-1] + table[:, 3:]) / 48.0
        error = np.abs(splines - face.at(probed, middles))[:, middles > _GRAZING]
        if error.max() < _ERROR:
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
