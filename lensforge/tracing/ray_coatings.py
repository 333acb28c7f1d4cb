"""Coated faces as some rays meet them: the tables of reflectance, and the place of each ray among their rows."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.optics.coating_tables import coated_faces, coating_tables, whole_span
from lensforge.optics.media import Media
from lensforge.sources.bundle import RayBundle

_MOST_OUTSIDE = 0.01  # share of the flux beyond the wavelengths of a coating; it is traced as at their end
_EVEN = 1e-9  # relative: of steps that differ by rounding alone
_FIELDS = {"inner": "lens.inner_coating", "outer": "lens.outer_coating", "glass": "lens.cover_glass.coating"}


_Compiled = Float[np.ndarray, "..."] | None


@dataclass(frozen=True, eq=False)
class RayCoatings:
    """Table of each face, as in :class:`CoatingTables`; None: it reflects by Fresnel's formulas, or nothing.

    ``rows``: place among the rows of the tables, of each ray or of all; empty where no face is coated.
    """

    inner: Float[np.ndarray, "k a 2"] | None
    outer: Float[np.ndarray, "k b 2"] | None
    glass: Float[np.ndarray, "k c 2"] | None
    rows: Float[np.ndarray, " j"]

    @staticmethod
    def of(rays: RayBundle, media: Media, fresnel: bool = True) -> "RayCoatings":
        """Coatings of ``media`` for ``rays``; none of them without ``fresnel``, when no face loses light.

        Raises :class:`InputError` for light at whose wavelengths a coating is not known.
        """
        if not fresnel or not media.coated:
            return NO_COATINGS
        waves = rays.wavelengths_nm
        _require_known(rays, media)
        tables = coating_tables(media, whole_span(waves, media))
        rows = np.zeros(1)
        if waves is not None and len(tables.wavelengths_nm) > 1:
            rows = _places(waves, tables.wavelengths_nm)
        return RayCoatings(tables.inner, tables.outer, tables.glass, rows)

    @property
    def for_kernels(self) -> tuple[_Compiled, _Compiled]:
        """Tables of the inner and the outer face, as the compiled kernels take them."""
        return _compiled(self.inner), _compiled(self.outer)

    @property
    def of_glass(self) -> tuple[_Compiled, Float[np.ndarray, " j"]]:
        """Table of the cover glass as the compiled kernels take it, and the places of the rays among its rows."""
        return _compiled(self.glass), self.rows

    def part(self, part: slice) -> Float[np.ndarray, " i"]:
        """Rows of some of the rays."""
        return self.rows if len(self.rows) <= 1 else self.rows[part]


def _compiled(table: Float[np.ndarray, "k m 2"] | None) -> _Compiled:
    """A table of one row as that row: numba compiles the kernels for it without the search among rows."""
    return table[0] if table is not None and len(table) == 1 else table


NO_COATINGS = RayCoatings(None, None, None, np.empty(0))


def _places(waves: Float[np.ndarray, " n"], nodes: Float[np.ndarray, " k"]) -> Float[np.ndarray, " n"]:
    """Place of each wavelength among ``nodes``; by a quotient where these are evenly spaced: ten times as fast."""
    last = len(nodes) - 1
    step = (nodes[-1] - nodes[0]) / last
    if np.abs(np.diff(nodes) - step).max() > _EVEN * step:
        found: Float[np.ndarray, " n"] = np.interp(waves, nodes, np.arange(last + 1.0))
    else:
        found = np.clip((waves - nodes[0]) / step, 0.0, last)
    return found


def _require_known(rays: RayBundle, media: Media) -> None:
    waves, total = rays.wavelengths_nm, float(rays.flux.sum())
    for name, face in coated_faces(media).items():
        if face.known_nm is None:
            continue
        low, high = face.known_nm
        if waves is None:
            share, light = float(not low <= media.wavelength_nm <= high), f"light of {media.wavelength_nm:g} nm"
        else:
            share = float(rays.flux[(waves < low) | (waves > high)].sum()) / total
            light = f"light from {waves.min():g} to {waves.max():g} nm"
        if share > _MOST_OUTSIDE:
            raise InputError(
                f"{_FIELDS[name]}: known from {low:g} to {high:g} nm, and the source has {light}: {100.0 * share:.3g} "
                f"% of the flux is outside, at most {100.0 * _MOST_OUTSIDE:g} % may be; extend the coating's data, or "
                "correct the spectrum (lens.design_wavelength_nm for a source without one)"
            )
