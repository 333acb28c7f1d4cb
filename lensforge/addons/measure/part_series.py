"""Records of several parts of one mould: form of each part and cavity, their scatter, and the capability."""

from typing import Annotated, Any

import numpy as np
from jaxtyping import Float

from lensforge.addons.measure.capability import CAPABLE
from lensforge.results import Array, Count, Flag, Metric, NotNegative, Positive, Record, Text
from lensforge.results.figure import Figure
from lensforge.results.numerals import quantity

FaceMap = Annotated[Float[np.ndarray, "m m"], Array("m", "m", gaps=True)]


class PartForm(Record):
    """One part: ``profile_um``: twice its largest deviation (ISO 1101); ``rms_um``: over the face."""

    part: Text
    cavity: Text
    profile_um: NotNegative
    rms_um: NotNegative


def _of_cavity(series: Any, cavity: Any) -> str:
    after = "" if cavity.left_um is None else f"; {quantity(cavity.left_um, 'µm', digits=3)} after the correction"
    apart = f"; {quantity(cavity.apart_um, 'µm', digits=3)} from the common face"
    profile = f"; profile {quantity(cavity.profile_um, 'µm', digits=3)}"
    return f"rms, of {cavity.count} parts{apart if len(series.cavities) > 1 else ''}{profile}{after}"


class CavityForm(Record):
    """Mean of the parts of one cavity.

    ``mean_um``: rms of its deviation. ``apart_um``: rms of it less the common one. ``profile_um``: mean of the parts'.
    ``left_um``: rms expected once the common face is corrected; None without a correction. ``map_um``: its deviation.
    """

    cavity: Text
    count: Count
    mean_um: Annotated[
        NotNegative,
        Figure(
            lambda series, cavity: f"Mean deviation{f', {cavity.cavity}' if cavity.cavity else ''}",
            _of_cavity,
            key=lambda series, cavity: f"cavity_{cavity.cavity}",
            digits=3,
        ),
    ]
    apart_um: NotNegative
    profile_um: NotNegative
    left_um: NotNegative | None = None
    map_um: FaceMap


_MEASURED = 0.3  # of the tolerance: twice the error of a place, at most (ISO 22514-7)


def _of_place(series: Any, place: Any) -> str:
    limit = quantity(place.limit, place.mean.unit, digits=3)
    worst = " of the worst cavity" if len(series.cavities) > 1 else ""
    return f"within ±{limit}; Cp {place.cp}; mean{worst} {place.mean}, standard deviation {place.scatter}"


def _measured_badly(series: Any, place: Any) -> str:
    if 2.0 * place.part_error <= _MEASURED * place.limit:
        return ""
    error = quantity(place.part_error, place.mean.unit, digits=2)
    return f"a part's place is known to {error} alone, which counts as scatter: measure it more exactly"


class PlaceCapability(Record):
    """Place of the face in one ``direction``, against its tolerance.

    In µm or degrees: ``limit``: the tolerance, either way; ``mean``: of the cavity that is farthest off; ``scatter``:
    standard deviation within cavities; ``part_error``: rms of the standard errors of the parts' places.
    """

    direction: Text
    limit: Positive
    mean: Metric
    scatter: Metric
    part_error: NotNegative
    cp: Metric
    cpk: Annotated[
        Metric,
        Figure(
            lambda series, place: f"Cpk, {place.direction}",
            _of_place,
            key=lambda series, place: f"cpk_{place.direction.replace(' ', '_')}",
            limit=CAPABLE,
            sense=">=",
            limit_note="customary",
            notice=_measured_badly,
        ),
    ]


def _scatter_of(series: Any) -> str:
    of = "parts of a cavity" if series.repeats else "all parts; a cavity has one alone, measure two of each"
    return f"of {of}, rms over the face, {series.freedom} degrees of freedom"


class PartSeries(Record):
    """Several parts of one mould, by cavity; deviations are along the normal, and extents rms over the area.

    ``parts``, ``cavities``: each part, and their means. ``wavelength_mm``: of the filter of all. ``repeats``: the
    scatter is within cavities, not that of all parts. ``freedom``: its degrees of freedom. ``common_um``: of the face
    that the cavities have in common; ``common_error_um``: its standard error. ``repeatability_um``: standard deviation
    of parts, ``between_um``: of cavities. ``zone_um``: full width of the zone of ``manufacture.form_tolerance_um``.
    ``cp``: of that zone by the repeatability; ``cpk``: of the parts' profiles, of the worst cavity. ``exchanged``:
    parts whose labels seem to be mixed up. ``places``: capability of each direction in which the face is toleranced;
    ``place_registered``: some are not judged, as the registration takes them out. ``scatter_map_um``: standard
    deviation of parts over the face.
    """

    parts: tuple[PartForm, ...]
    cavities: tuple[CavityForm, ...]
    wavelength_mm: Positive
    repeats: Flag
    freedom: Count
    common_um: Annotated[
        NotNegative,
        Figure("Common to the cavities", "rms ± {common_error_um:2}, {wavelength_mm:3} and longer", digits=3),
    ]
    common_error_um: NotNegative
    repeatability_um: Annotated[Metric, Figure("Repeatability", _scatter_of)]
    between_um: Annotated[Metric | None, Figure("Between cavities", "standard deviation, rms over the face")]
    zone_um: Positive | None
    cp: Annotated[
        Metric | None,
        Figure("Cp", "zone over six repeatabilities", missing="none: manufacture.form_tolerance_um is not given"),
    ]
    cpk: Annotated[
        Metric | None,
        Figure(
            "Cpk",
            "of the profile in a zone of {zone_um:4}, of the worst cavity",
            limit=CAPABLE,
            sense=">=",
            limit_note="customary",
        ),
    ]
    exchanged: Annotated[
        tuple[Text, ...],
        Figure(
            "Labels",
            value=lambda series: " and ".join(series.exchanged),
            notice="exchanged, parts of a cavity would be far more alike: are they mixed up?",
            when=lambda series: bool(series.exchanged),
        ),
    ] = ()
    places: tuple[PlaceCapability, ...] = ()
    place_registered: Annotated[
        Flag,
        Figure(
            "Place of the face",
            "its registration takes it out; measure against datums, --registration none",
            value=lambda series: "not judged",
            when=lambda series: series.place_registered,
        ),
    ] = False
    scatter_map_um: FaceMap
