"""The measured face of one part, or the face that several parts have in common, and how these scatter about it.

Points of all parts, each registered by itself, are filtered together as those of one part; cavities count alike.
"""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from lensforge.addons.measure.areal_filter import ArealFilter, PointDeviations
from lensforge.addons.measure.capability import cp, upper_cpk
from lensforge.addons.measure.first_cut import FilterRange, FirstCut, Request, TriedFilter, deviations_of
from lensforge.addons.measure.measured_points import PartPoints
from lensforge.addons.measure.measurement_result import USED_SHARE, Registration
from lensforge.addons.measure.nominal_face import FacePixels, NominalFace
from lensforge.addons.measure.part_scatter import PartScatter, weights_of
from lensforge.addons.measure.part_series import CavityForm, PartForm, PartSeries
from lensforge.addons.measure.registration import Registered, RigidMotion, registered
from lensforge.cad.patch import Patch
from lensforge.errors import FileWarning, InputError
from lensforge.results.numerals import percent


def common_cut(parts: Sequence[PartPoints], face: NominalFace, request: Request, zone_um: float | None) -> FirstCut:
    """The measured face of one part, or what several parts have in common: the mean over their cavities.

    ``zone_um``: width of the zone of the form tolerance, for their capability. Raises :class:`InputError` for points
    that cannot be registered, and for a part that is not of this lens, or like no other.
    """
    if len(parts) == 1:
        return FirstCut.of(face.surface, face.patch, parts[0].cloud, request, face.domain)
    placed = [_placed(part, face.patch, request.registration) for part in parts]
    deviations = [deviations_of(face.surface, of_part, face.domain) for of_part in placed]
    spans = [_span(part, points) for part, points in zip(parts, deviations, strict=True)]
    counts = [len(of_part.points) for of_part in placed]
    weights = weights_of([part.cavity for part in parts])
    points = np.concatenate([of_part.points for of_part in placed])
    together = Registered(RigidMotion(*np.zeros((4, 3))), points, min(of_part.share for of_part in placed))
    pooled = deviations_of(face.surface, together, face.domain, np.repeat(weights / counts, counts))
    cut = FirstCut.on(together, _without_long_waves_of(deviations, pooled), request)
    # As many waves as the common face has, where the points of each part can show them.
    wavelength_mm = max([cut.likeliest.areal.wavelength_mm, *(span.shortest_mm for span in spans)])
    measured = [
        _MeasuredPart(part, of_part.share, TriedFilter.of(points, wavelength_mm), span.covered(points))
        for part, of_part, points, span in zip(parts, placed, deviations, spans, strict=True)
    ]
    scatter = _scatter(measured, face.pixels)
    residuals = pooled.deviations - cut.likeliest.values
    return replace(
        cut,
        covered=min(part.covered for part in measured),
        noise_mm=float(np.sqrt(np.mean([part.filter.noise_mm**2 for part in measured]))),
        again=cut.likeliest.values + np.repeat(scatter.contrast(), counts) * residuals,
        series=_series(measured, scatter, face.pixels, zone_um),
    )


def _without_long_waves_of(parts: Sequence[PointDeviations], pooled: PointDeviations) -> PointDeviations:
    """The ``pooled`` points, whose parts differ in short waves and noise alone.

    Parts of one process differ in long waves. What is left tells the wavelength of the common face, whose long waves
    stay as they are.
    """
    longest_mm = pooled.largest_radius_mm
    alone = np.concatenate([ArealFilter(points, longest_mm).solve().values for points in parts])
    common = ArealFilter(pooled, longest_mm).solve().values
    return replace(pooled, deviations=pooled.deviations - alone + common)


@dataclass(frozen=True)
class _MeasuredPart:
    """A registered part: share of its points on the face, their filter, share of the face they cover."""

    part: PartPoints
    used: float
    filter: TriedFilter
    covered: float


def _placed(part: PartPoints, patch: Patch, registration: Registration) -> Registered:
    with _named(part):
        placed = registered(patch, part.cloud, registration)
    if placed.share < USED_SHARE:
        raise InputError(
            f"{part.name}: {percent(placed.share)} of its points lie on the face, must be {percent(USED_SHARE)} at "
            "least: is it of another lens? Leave it out, or compare it alone"
        )
    return placed


@contextmanager
def _named(part: PartPoints) -> Iterator[None]:
    """Put the name of the part before errors and warnings on its points."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FileWarning)
        try:
            yield
        except InputError as error:
            raise InputError(f"{part.name}: {error}") from None
    for warning in caught:
        warnings.warn(f"{part.name}: {warning.message}", warning.category, stacklevel=2)


def _span(part: PartPoints, points: PointDeviations) -> FilterRange:
    with _named(part):
        return FilterRange.of(points)


def _scatter(measured: Sequence[_MeasuredPart], pixels: FacePixels) -> PartScatter:
    """Scatter of the parts over the face. Raises :class:`InputError` for a part that is like no other."""
    inside = pixels.inside
    deviations = np.stack([pixels.map_um(part.filter.filtered.change)[inside] for part in measured])
    areas = pixels.area_mm2[inside]
    scatter = PartScatter(tuple(part.part.cavity for part in measured), deviations, areas / areas.sum())
    odd = scatter.odd_one()
    if odd is not None:
        raise InputError(
            f"{measured[odd.part].part.name}: its form is {odd.nearest_um:.3g} µm rms from that of the nearest part, "
            f"where others differ by {odd.usual_um:.3g}: is it of another lens? Leave it out, or compare it alone"
        )
    return scatter


def _series(
    measured: Sequence[_MeasuredPart], scatter: PartScatter, pixels: FacePixels, zone_um: float | None
) -> PartSeries:
    profiles = 2.0 * np.abs(scatter.deviations).max(axis=1)
    exchanged = scatter.exchanged()
    return PartSeries(
        parts=tuple(
            PartForm(
                part=of_part.part.name,
                cavity=of_part.part.cavity,
                profile_um=float(profile),
                rms_um=scatter.rms(deviation),
                used_share=of_part.used,
                covered_share=of_part.covered,
            )
            for of_part, profile, deviation in zip(measured, profiles, scatter.deviations, strict=True)
        ),
        cavities=tuple(
            CavityForm(
                cavity=cavity,
                count=len(members),
                mean_um=scatter.rms(mean),
                apart_um=scatter.rms(mean - scatter.common),
                profile_um=float(profiles[members].mean()),
                map_um=pixels.over_face(mean),
            )
            for (cavity, members), mean in zip(scatter.members.items(), scatter.means, strict=True)
        ),
        wavelength_mm=measured[0].filter.filtered.areal.wavelength_mm,
        repeats=scatter.repeats,
        freedom=scatter.freedom,
        common_um=scatter.rms(scatter.common),
        common_error_um=scatter.common_error_um,
        repeatability_um=scatter.repeatability,
        between_um=scatter.between,
        zone_um=zone_um,
        cp=None if zone_um is None else cp(zone_um, scatter.repeatability),
        cpk=None if zone_um is None else upper_cpk(zone_um, [profiles[group] for group in scatter.groups]),
        exchanged=() if exchanged is None else tuple(measured[part].part.name for part in exchanged),
        scatter_map_um=pixels.over_face(scatter.at_places),
    )
