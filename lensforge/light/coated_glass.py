"""Coated faces as some rays meet them, and light through the cover glass: exit rays behind a plane-parallel plate.

A plate of thickness t and index n_g in a medium of index n_o leaves the direction of a ray as it is, and its line as if
the ray had started nearer by ``t (1 - n_o cos a / (n_g cos b))`` along the plate's normal, a and b the angles outside
and inside (Born and Wolf, Principles of Optics, 4.7). Each face transmits by Fresnel, or by its coating, what comes
polarised in the plane of the ray and z, and across it; what they reflect goes back and is followed no further. Without
``fresnel`` its faces let all light through.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.kernels.glass_plate import GlassPlate, behind_plate, behind_plate_adjoint
from lensforge.kernels.parallel import in_chunks, part_of
from lensforge.kernels.traced_body import ByRaysOut, FaceFilms, RaysOut
from lensforge.optics.coatings import GLASS, coated_faces, coating_tables, whole_span
from lensforge.optics.media import CoverGlass, Media
from lensforge.scene.exit_rays import ExitRays
from lensforge.sources.ray_bundle import RayBundle

_MOST_OUTSIDE = 0.01  # share of the flux beyond the wavelengths of a coating; it is traced as at their end
_EVEN = 1e-9  # relative: of steps that differ by rounding alone


_Compiled = Float[np.ndarray, "..."] | None


@dataclass(frozen=True, eq=False)
class RayCoatings:
    """Table of each coated face, as in :class:`CoatingTables`; uncoated faces reflect by Fresnel's formulas, if at all.

    ``rows``: fractional row of the tables, for each ray or one for all.
    """

    faces: Mapping[str, Float[np.ndarray, "k m 2"]]
    rows: Float[np.ndarray, " j"]

    @staticmethod
    def of(rays: RayBundle, media: Media, fresnel: bool = True, origin: str = "lens.") -> "RayCoatings":
        """Coatings of ``media`` for ``rays``; none without ``fresnel``, when no face loses light.

        Raises :class:`InputError` for wavelengths at which a coating is not known; ``origin``: prefix of the field
        named in the error.
        """
        if not fresnel or not media.coated:
            return NO_COATINGS
        waves = rays.wavelengths_nm
        _require_known(rays, media, origin)
        tables = coating_tables(media, whole_span(waves, media))
        rows = np.zeros(1)
        if waves is not None and len(tables.wavelengths_nm) > 1:
            rows = _places(waves, tables.wavelengths_nm)
        return RayCoatings(tables.faces, rows)

    def for_kernels(self, names: tuple[str, ...]) -> FaceFilms | None:
        """Tables of the faces ``names`` for the compiled kernels; None if all are bare."""
        tables = [self.faces.get(name) for name in names]
        known = [table for table in tables if table is not None]
        if not known:
            return None
        most = max(table.shape[1] for table in known)
        stacked = np.zeros((len(names), len(known[0]), most, 2))
        for number, table in enumerate(tables):
            if table is not None:
                stacked[number, :, : table.shape[1]] = table
        sizes = np.array([0 if table is None else table.shape[1] for table in tables])
        return FaceFilms(stacked[:, 0] if len(known[0]) == 1 else stacked, sizes)


def _compiled(table: Float[np.ndarray, "k m 2"] | None) -> _Compiled:
    """A table of one row as that row: numba then compiles the kernels without the search among rows."""
    return table[0] if table is not None and len(table) == 1 else table


NO_COATINGS = RayCoatings({}, np.zeros(1))


def _places(waves: Float[np.ndarray, " n"], nodes: Float[np.ndarray, " k"]) -> Float[np.ndarray, " n"]:
    """Fractional row of each wavelength among ``nodes``; by division if these are evenly spaced: ten times as fast."""
    last = len(nodes) - 1
    step = (nodes[-1] - nodes[0]) / last
    if np.abs(np.diff(nodes) - step).max() > _EVEN * step:
        places: Float[np.ndarray, " n"] = np.interp(waves, nodes, np.arange(last + 1.0))
    else:
        places = np.clip((waves - nodes[0]) / step, 0.0, last)
    return places


def _require_known(rays: RayBundle, media: Media, origin: str) -> None:
    waves = rays.wavelengths_nm
    total = float(rays.flux.sum())
    for name, face in coated_faces(media).items():
        if face.known_nm is None:
            continue
        low, high = face.known_nm
        if waves is None:
            share = float(not low <= media.wavelength_nm <= high)
            light = f"light of {media.wavelength_nm:g} nm"
        else:
            share = float(rays.flux[(waves < low) | (waves > high)].sum()) / total
            light = f"light from {waves.min():g} to {waves.max():g} nm"
        if share > _MOST_OUTSIDE:
            raise InputError(
                f"{origin}{'cover_glass' if name == 'glass' else name}.coating: known from {low:g} to {high:g} nm, and "
                f"the source has {light}: {100.0 * share:.3g} % of the flux is outside, at most "
                f"{100.0 * _MOST_OUTSIDE:g} % may be; extend the coating's data, or correct the spectrum "
                "(lens.design_wavelength_nm for a source without one)"
            )


def behind_glass(rays: ExitRays, media: Media, fresnel: bool = True, coatings: RayCoatings = NO_COATINGS) -> ExitRays:
    """``rays``, NumPy arrays, behind the cover glass of ``media``; unchanged without one."""
    if media.cover_glass is None:
        return rays
    plate = _plate(media.cover_glass, media, fresnel, coatings)
    out = _copied(rays)
    lost = np.empty(len(rays.flux))

    def work(_: int, part: slice) -> None:
        behind_plate(out.part(part), plate, part_of(coatings.rows, part), lost[part])

    in_chunks(work, len(lost))
    return replace(rays, points=out.points, flux=out.flux, lost_in_glass=lost)


def before_glass(
    rays: ExitRays, media: Media, by: ByRaysOut, fresnel: bool, coatings: RayCoatings = NO_COATINGS
) -> ByRaysOut:
    """Sensitivities to ``rays`` from those to the rays behind the cover glass; unchanged without one.

    None for the axial flux if nothing reflects.
    """
    if media.cover_glass is None:
        return by
    plate = _plate(media.cover_glass, media, fresnel, coatings)
    count = len(rays.flux)
    before = by._replace(by_directions=by.by_directions.copy(), by_flux=by.by_flux.copy(), by_axial=np.empty(count))
    out = _copied(rays)

    def work(_: int, part: slice) -> None:
        behind_plate_adjoint(out.part(part), plate, part_of(coatings.rows, part), before.part(part))

    in_chunks(work, count)
    return before if fresnel else before._replace(by_axial=None)


def _copied(rays: ExitRays) -> RaysOut:
    """Copies of the rays, whose points and flux the plate may change in place."""
    axial = np.zeros(len(rays.flux)) if rays.axial is None else rays.axial
    none = np.zeros(0)
    return RaysOut(rays.points.copy(), rays.directions, rays.flux.copy(), none, rays.sin2_exit, rays.fates, axial)


def _plate(glass: CoverGlass, media: Media, fresnel: bool, coatings: RayCoatings) -> GlassPlate:
    film = _compiled(coatings.faces.get(GLASS))
    ratio = media.outside_index / glass.refractive_index
    return GlassPlate(fresnel, ratio, glass.thickness_mm, glass.absorption_per_mm, film)
