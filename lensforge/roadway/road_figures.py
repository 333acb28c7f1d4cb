"""Figures of a lamp for areas and roads, as one record."""

from typing import Literal

import numpy as np
from jaxtyping import Float

from lensforge.records import Metric, Record
from lensforge.roadway.bug_rating import BugRating, ZoneLumens
from lensforge.roadway.distribution_type import DistributionType, distribution_type
from lensforge.roadway.en13201 import GlareIntensities, RoadLighting, glare_intensities, road_lighting
from lensforge.roadway.lamp_light import LampLight
from lensforge.spec.photometry import PhotometrySection


class RoadFigures(Record):
    """Figures of a lamp with all its lenses. ``lumens``: that leave it. ``road``: None for ``use = "area"``."""

    use: Literal["area", "road"]
    lumens: Metric
    distribution: DistributionType
    bug: BugRating
    glare: GlareIntensities
    road: RoadLighting | None

    @staticmethod
    def of(
        section: PhotometrySection, lens: LampLight, lens_lm: Metric, zones_lm: Float[np.ndarray, "p 2 4"]
    ) -> "RoadFigures | None":
        """Figures of a lamp of ``section``, each lens with such light and flux by zone; None for general use."""
        if section.use == "general":
            return None
        lamp = lens.times(section.lenses)
        distribution = distribution_type(lamp)
        error = None if lens_lm.standard_error is None else lens_lm.standard_error * section.lenses
        lumens = Metric(value=lens_lm.value * section.lenses, unit="lm", standard_error=error)
        return RoadFigures(
            use=section.use,
            lumens=lumens,
            distribution=distribution,
            bug=BugRating.of(
                ZoneLumens.of(zones_lm * section.lenses),
                symmetric=distribution.lateral == "V",
                doubtful=not distribution.certain,
            ),
            glare=glare_intensities(lamp, lumens.value),
            road=road_lighting(lamp, section) if section.use == "road" else None,
        )
