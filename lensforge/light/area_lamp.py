"""A lamp for an area or a road: its figures with all its lenses.

Classes of glare G*: EN 13201-2:2015, table A.1.
"""

from typing import Annotated

import numpy as np
from jaxtyping import Float

from lensforge.light.luminaire_classes import BugRating, DistributionType, LampLight, ZoneLumens, distribution_type
from lensforge.results import Metric, Record, Text
from lensforge.results.estimates import debiased_maximum, scaled
from lensforge.results.figure import Figure
from lensforge.spec.light_limits import PhotometrySection

_NONE = "none"
# Most candela per 1000 lm of the lamp at and above 70 and 80 degrees; none shines at 90, so that G*5 is G*6.
_G = {
    "G*6": (350.0, 100.0),
    "G*4": (500.0, 100.0),
    "G*3": (np.inf, 100.0),
    "G*2": (np.inf, 150.0),
    "G*1": (np.inf, 200.0),
}


class GlareIntensities(Record):
    """Largest intensity (cd per 1000 lm of the lamp) at and above 70 and 80 degrees; a lens emits none above 90.

    ``glare_class``: the strictest class of glare that these keep, or "none".
    """

    glare_class: Annotated[Text, Figure("Glare class", "EN 13201", key="glare_class")]
    above_70: Annotated[Metric, Figure("Max. from 70° up", "cd/klm", key="above_70")]
    above_80: Annotated[Metric, Figure("Max. from 80° up", "cd/klm", key="above_80")]


def glare_intensities(lamp: LampLight, lumens: float) -> GlareIntensities:
    """Largest intensities of ``lamp`` near the horizon, corrected for the bias of noise."""
    above_70, above_80 = (_largest_from(lamp, gamma, 1000.0 / lumens) for gamma in (70.0, 80.0))
    keeps = (name for name, (at_70, at_80) in _G.items() if above_70.value <= at_70 and above_80.value <= at_80)
    return GlareIntensities(above_70=above_70, above_80=above_80, glare_class=next(keeps, _NONE))


def _largest_from(lamp: LampLight, gamma_deg: float, scale: float) -> Metric:
    nodes = np.append(gamma_deg, lamp.grid.gamma_deg[lamp.grid.gamma_deg > gamma_deg])
    lateral, gamma = (angles.ravel() for angles in np.meshgrid(lamp.grid.c_deg - lamp.street_deg, nodes, indexing="ij"))
    largest = debiased_maximum(scale * lamp.intensities(lateral, gamma))
    return largest.changed(value=max(largest.value, 0.0), unit="cd/klm")


class AreaLamp(Record):
    """Figures of a lamp with all its lenses. ``lumens``: flux that leaves it."""

    lumens: Annotated[Metric, Figure("Luminous flux, lamp", key="lamp_lm")]
    distribution: Annotated[DistributionType, Figure("IES distribution", of="name")]
    bug: Annotated[
        BugRating,
        Figure(
            "BUG rating", lambda photometry, lamp, whole: whole, value=lambda photometry, lamp, whole: str(lamp.bug)
        ),
    ]
    glare: GlareIntensities

    @staticmethod
    def of(
        section: PhotometrySection, lens: LampLight, lens_lm: Metric, zones_lm: Float[np.ndarray, "p 2 4"]
    ) -> "AreaLamp | None":
        """Figures of a lamp of ``section``, each lens with this flux, total and by zone; None for general use."""
        if section.use == "general":
            return None
        lamp = lens.times(section.lenses)
        distribution = distribution_type(lamp)
        lumens = scaled(lens_lm, float(section.lenses), "lm")
        return AreaLamp(
            lumens=lumens,
            distribution=distribution,
            bug=BugRating.of(ZoneLumens.of(zones_lm * section.lenses), symmetric=distribution.lateral == "V"),
            glare=glare_intensities(lamp, lumens.value),
        )
