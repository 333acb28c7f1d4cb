"""The measured face of one part, or the face that several parts have in common, and how these scatter about it.

Points of all parts, each registered by itself, are filtered together as those of one part; cavities count alike.
"""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from lensforge.addons.measure.areal_filter import ArealFilter, FilteredPoints, PointDeviations
from lensforge.addons.measure.capability import cp, cpk
from lensforge.addons.measure.first_cut import FilterRange, FirstCut, Request, TriedFilter, deviations_of
from lensforge.addons.measure.measured_points import PartPoints
from lensforge.addons.measure.measurement_result import USED_SHARE, Registration
from lensforge.addons.measure.nominal_face import FacePixels, NominalFace
from lensforge.addons.measure.part_places import left_by, place_capabilities
from lensforge.addons.measure.part_scatter import PartScatter
from lensforge.addons.measure.part_series import CavityForm, PartForm, PartSeries
from lensforge.addons.measure.registration import Registered, RigidMotion, register, registered
from lensforge.errors import FileWarning, InputError
from lensforge.results.numerals import percent


def common_cut(parts: Sequence[PartPoints], face: NominalFace, request: Request) -> FirstCut:
    """The measured face of one part, or what several parts have in common: the mean over their cavities.

    Raises :class:`InputError` for points that cannot be registered, and for a part that is not of this lens, or like
    no other.
    """
    if len(parts) == 1:
        return FirstCut.of(face.surface, face.patch, parts[0].cloud, request, face.domain)
    placed = [_PlacedPart.of(part, face, request.registration) for part in parts]
    counts = [len(part.points.deviations) for part in placed]
    labels = [part.cavity for part in parts]
    weights = [1.0 / (labels.count(label) * count) for label, count in zip(labels, counts, strict=True)]
    pooled = PointDeviations(
        face.surface,
        np.concatenate([part.points.directions for part in placed]),
        np.concatenate([part.points.deviations for part in placed]),
        face.domain,
        np.repeat(weights, counts),
    )
    together = Registered(
        RigidMotion(*np.zeros((4, 3))),
        np.concatenate([part.placed.points for part in placed]),
        min(part.placed.share for part in placed),
    )
    cut = FirstCut.on(together, _without_long_waves_of(placed, pooled), request)
    # As many waves as the common face has, where the points of each part can show them.
    wavelength_mm = max([cut.likeliest.areal.wavelength_mm, *(part.span.shortest_mm for part in placed)])
    filters = [TriedFilter.of(part.points, wavelength_mm) for part in placed]
    scatter = _scatter(parts, [tried.filtered for tried in filters], face.pixels)
    scatter.require_alike()
    judged = left_by(request.registration, face.places)
    motions = [register(face.patch, part.placed.points) for part in placed] if judged else []
    places = tuple(place_capabilities(motions, scatter.groups, judged)) if judged else ()
    residuals = pooled.deviations - cut.likeliest.values
    return replace(
        cut,
        covered=min(part.covered for part in placed),
        noise_mm=float(np.sqrt(np.mean([tried.noise_mm**2 for tried in filters]))),
        again=cut.likeliest.values + np.repeat(scatter.contrast(), counts) * residuals,
        count=sum(len(part.cloud) for part in parts),
        series=_series(scatter, face, wavelength_mm).changed(
            places=places, place_registered=len(judged) < len(face.places)
        ),
    )


@dataclass(frozen=True)
class _PlacedPart:
    """A registered part, the deviations of its points, the waves that they can show, the share that they cover."""

    placed: Registered
    points: PointDeviations
    span: FilterRange
    covered: float

    @staticmethod
    def of(part: PartPoints, face: NominalFace, registration: Registration) -> "_PlacedPart":
        with _named(part):
            placed = registered(face.patch, part.cloud, registration)
            if placed.share < USED_SHARE:
                raise InputError(
                    f"{percent(placed.share)} of its points lie on the face, must be {percent(USED_SHARE)} at least: "
                    "is it of another lens? Leave it out, or compare it alone"
                )
            points = deviations_of(face.surface, placed, face.domain)
            span = FilterRange.of(points)
        return _PlacedPart(placed, points, span, span.covered(points))


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


def _without_long_waves_of(parts: Sequence[_PlacedPart], pooled: PointDeviations) -> PointDeviations:
    """The ``pooled`` points, whose parts then differ in short waves and noise alone.

    Parts of one process differ in long waves, which would pass for noise. Those of the common face stay as they are.
    """
    longest_mm = pooled.largest_radius_mm
    alone = np.concatenate([ArealFilter(part.points, longest_mm).solve().values for part in parts])
    common = ArealFilter(pooled, longest_mm).solve().values
    return replace(pooled, deviations=pooled.deviations - alone + common)


def _scatter(parts: Sequence[PartPoints], filtered: Sequence[FilteredPoints], pixels: FacePixels) -> PartScatter:
    areas = pixels.area_mm2[pixels.inside]
    return PartScatter(
        names=tuple(part.name for part in parts),
        cavities=tuple(part.cavity for part in parts),
        deviations=np.stack([pixels.map_um(of_part.change)[pixels.inside] for of_part in filtered]),
        shares=areas / areas.sum(),
    )


def _series(scatter: PartScatter, face: NominalFace, wavelength_mm: float) -> PartSeries:
    pixels = face.pixels
    profiles = 2.0 * np.abs(scatter.deviations).max(axis=1)
    forms = (
        PartForm(
            part=name,
            cavity=cavity,
            profile_um=float(profile),
            rms_um=scatter.rms(deviation),
        )
        for name, cavity, profile, deviation in zip(
            scatter.names, scatter.cavities, profiles, scatter.deviations, strict=True
        )
    )
    cavities = (
        CavityForm(
            cavity=cavity,
            count=len(members),
            mean_um=scatter.rms(mean),
            apart_um=scatter.rms(mean - scatter.common),
            profile_um=float(profiles[members].mean()),
            map_um=pixels.over_face(mean),
        )
        for (cavity, members), mean in zip(scatter.members.items(), scatter.means, strict=True)
    )
    return PartSeries(
        parts=tuple(forms),
        cavities=tuple(cavities),
        wavelength_mm=wavelength_mm,
        repeats=scatter.repeats,
        freedom=scatter.freedom,
        common_um=scatter.rms(scatter.common),
        common_error_um=scatter.common_error_um,
        repeatability_um=scatter.repeatability,
        between_um=scatter.between,
        zone_um=face.zone_um,
        cp=None if face.zone_um is None else cp(face.zone_um, scatter.repeatability),
        cpk=None if face.zone_um is None else cpk([profiles[group] for group in scatter.groups], face.zone_um),
        exchanged=scatter.exchanged(),
        scatter_map_um=pixels.over_face(scatter.at_places),
    )
