"""Light at places by the intensities of a lamp: figures with their errors, limits, and applications judged.

Intensities are those of the table that the photometric file holds. Of light by independent samples of rays each figure
has a standard error by the jackknife, of a file none.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge.light.judged_limits import judged
from lensforge.light.luminaire_classes import LampLight
from lensforge.results import Fact, Metric, Sense
from lensforge.results.estimates import jackknife_error
from lensforge.scene.application_light import ApplicationJudgement, light_in
from lensforge.scene.intensity_limit import Candela, CandelaSum, IntensityLimit
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric.photometric_file import PhotometricFile
from lensforge.spec import Spec
from lensforge.spec.application import Application, names_of
from lensforge.spec.quantities import Quantity


@dataclass(frozen=True)
class IntensityFigures:
    """Figures by the intensities of a lamp; those of a file have no standard error."""

    candela: Candela

    def figure(self, quantity: Quantity, sense: Sense, unit: str, light: CandelaSum) -> Metric:
        """The ``quantity`` of ``light``."""
        whole, *left_out = (quantity.value(row[None], sense, unit, row[None]) for row in light.of(self.candela(light)))
        error = jackknife_error(np.array([value.value for value in left_out])) if left_out else 0.0
        return whole.changed(unit=unit, standard_error=error)

    def judged(self, limits: Iterator[IntensityLimit], name: str) -> Iterator[Fact]:
        """Judge each limit that the application ``name`` requires."""
        for limit in limits:
            yield judged(limit, name, self.figure(limit.quantity, limit.sense, limit.unit, limit.light))


def judgements(spec: Spec, lens: LampLight, source_lm: float) -> dict[str, tuple[ApplicationJudgement, ...]]:
    """The applications of ``spec``, by table, lit by lamps of a lens with this light over a source of ``source_lm``."""
    by_table: dict[str, tuple[ApplicationJudgement, ...]] = {}
    for entry, name in zip(spec.applications, names_of(spec.applications), strict=True):
        candela = of_lens(lens, lenses_in(entry, spec, source_lm))
        by_table[entry.table] = (*by_table.get(entry.table, ()), light_in(entry).judged(candela, name))
    return by_table


def limits_judged(spec: Spec, lens: LampLight, source_lm: float) -> Iterator[Fact]:
    """Judge only the requirements of the applications of ``spec``; their other figures are left out."""
    for entry, name in zip(spec.applications, names_of(spec.applications), strict=True):
        figures = IntensityFigures(of_lens(lens, lenses_in(entry, spec, source_lm)))
        for limit in figures.judged(light_in(entry).limits(), name):
            label = f"{name}: {limit.label}"
            yield replace(limit, key=label, label=label)


def lenses_in(entry: Application, spec: Spec, source_lm: float) -> float:
    """Lenses in a lamp, each over a source of ``source_lm``: the number that gives the entry's lumens, if stated."""
    return float(spec.photometry.lenses) if entry.lamp_lm is None else entry.lamp_lm / source_lm


def of_lens(lamp: LampLight, factor: float) -> Candela:
    """Intensities of ``lamp`` times ``factor``; 0 above 90 degrees, where a lens emits no light."""
    tables = lamp.in_file()

    def candela(light: CandelaSum) -> Float[np.ndarray, "p n"]:
        intensities = factor * tables.intensities(light.azimuth_deg, light.gamma_deg)
        return np.asarray(intensities * (light.gamma_deg <= 90.0))

    return candela


def of_file(file: PhotometricFile, street_c_deg: float, lamp_lm: float | None) -> Candela:
    """Intensities of the lamp of a photometric file whose C = ``street_c_deg`` is towards the street.

    ``lamp_lm``: flux of its sources; None: as the file states. An absolute file states the light that leaves the lamp.
    """
    stated = file.rated_lumens
    return of_table(TabulatedIntensity.of(file.intensity), street_c_deg, 1.0 if lamp_lm is None else lamp_lm / stated)


def of_table(table: TabulatedIntensity, street_c_deg: float, factor: float) -> Candela:
    """Intensities of a lamp of ``factor`` times the ``table``, whose C = ``street_c_deg`` is towards the street."""

    def candela(light: CandelaSum) -> Float[np.ndarray, "1 n"]:
        turn = np.radians(street_c_deg - light.azimuth_deg)
        gamma = np.radians(light.gamma_deg)
        units = np.stack([np.sin(gamma) * np.cos(turn), np.sin(gamma) * np.sin(turn), np.cos(gamma)], axis=1)
        return np.asarray(factor * table.flux() * table.intensity(units)[None])

    return candela
