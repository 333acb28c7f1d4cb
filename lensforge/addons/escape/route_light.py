"""Light on an escape route below a row of equal lamps, as sums over the intensities of one (EN 1838).

Points lie between two lamps of a row without end. Lamps count up to twelve heights away, in plan.
"""

from collections.abc import Iterator, Mapping
from math import ceil
from typing import Annotated, ClassVar

import numpy as np

from lensforge.addons.escape.route_section import RouteSection
from lensforge.results import Fact, Group, Metric
from lensforge.results.figure import Figure, facts_in
from lensforge.scene.application_light import ApplicationJudgement, ApplicationLight
from lensforge.scene.intensity_limit import Candela, CandelaSum, IntensityLimit
from lensforge.spec.quantities import MostOverLeast, PlaceLight

_STEP = 0.1  # largest, of the height, between points along the route
_BAND = (-0.25, -0.125, 0.0, 0.125, 0.25)  # lines of the central band, over the width of the route
_REACH = 12.0  # of the height
_LARGEST_OVER_LEAST = 40.0
_BAND_OVER_LINE = 0.5
_GLARE_DEG = np.arange(60.0, 90.5, 1.0)
_GLARE_C_DEG = np.arange(0.0, 360.0, 2.5)  # a lens for a route has narrow peaks
_FILE_X_DEG = -90.0  # x of a lamp, from its street: the spec's default street is y


class RouteJudgement(ApplicationJudgement):
    """Light on one escape route. ``line_lx``: mean illuminance of its centre line."""

    line_lx: Annotated[Metric, Figure("Mean illuminance", "of the centre line", key="route_lx")]


class RouteLight(ApplicationLight[RouteSection, RouteJudgement]):
    """The light of a row of lamps on an escape route."""

    judgement = RouteJudgement
    remedies: ClassVar[Mapping[str, str]] = {
        PlaceLight.phrase: "lamps nearer to each other, or more light towards the middle between two of them",
        MostOverLeast.phrase: "less light below the lamps, or lamps nearer to each other; the flux does not change it",
    }

    def limits(self) -> Iterator[IntensityLimit]:
        """The minimum of centre line and band, max/min of the line, and the largest intensity that glares."""
        least = self.entry.line_lx
        line = self.illuminance((0.0,))
        yield IntensityLimit("centre line", PlaceLight(), ">=", least, "lx", line)
        yield IntensityLimit("central band", PlaceLight(), ">=", _BAND_OVER_LINE * least, "lx", self.illuminance(_BAND))
        yield IntensityLimit("max/min", MostOverLeast(), "<=", _LARGEST_OVER_LEAST, "", line)
        yield IntensityLimit("glare", PlaceLight(), "<=", self.entry.most_cd, "cd", self.glare())

    def illuminance(self, lines: tuple[float, ...]) -> CandelaSum:
        """Illuminance (lx) of the floor along ``lines`` between two lamps, each aside by a share of the width."""
        from scipy import sparse

        high_m = self.entry.height_m
        spacing_m = self.entry.spacing_m
        half = ceil(0.5 * spacing_m / (_STEP * high_m))
        along, aside = np.meshgrid(np.linspace(0.0, spacing_m, 2 * half + 1), self.entry.width_m * np.array(lines))
        away = ceil(_REACH * high_m / spacing_m)
        lamps = spacing_m * np.arange(-away, away + 2)
        east = along.ravel()[:, None] - lamps
        north = np.broadcast_to(aside.ravel()[:, None], east.shape)
        level = np.hypot(east, north)
        weights = self.entry.maintenance_factor * (level <= _REACH * high_m) * high_m / (level**2 + high_m**2) ** 1.5
        point, lamp = np.nonzero(weights)
        azimuth = np.degrees(np.arctan2(north, east))[point, lamp] + _FILE_X_DEG
        gamma = np.degrees(np.arctan(level / high_m))[point, lamp]
        entries = weights[point, lamp], (point, np.arange(len(point)))
        return CandelaSum(azimuth, gamma, sparse.csr_array(entries, shape=(along.size, len(point))))

    def glare(self) -> CandelaSum:
        """Intensity (cd) of a new lamp from 60 to 90 degrees, all around."""
        from scipy import sparse

        azimuth, gamma = (angles.ravel() for angles in np.meshgrid(_GLARE_C_DEG, _GLARE_DEG))
        return CandelaSum(azimuth, gamma, sparse.eye_array(len(gamma), format="csr"))

    def judged(self, candela: Candela, name: str) -> RouteJudgement:
        """The route by lamps of these intensities."""
        from lensforge.light.by_intensities import IntensityFigures

        read = IntensityFigures(candela)
        limits = tuple(read.judged(self.limits(), name))
        wanted = self.entry.lighting_class
        return RouteJudgement(
            name=name,
            lighting_class=wanted,
            reached=wanted if all(limit.holds for limit in limits) else "none",
            limits=limits,
            line_lx=read.figure(PlaceLight(), ">=", "lx", self.illuminance((0.0,)).mean()),
        )

    def facts(self, judgement: RouteJudgement) -> Group:
        """Its class, and the mean of its centre line."""
        note = f"EN 1838; achieved: {judgement.reached}, by the intensities of the file"
        head = Fact("route_class", "Class", judgement.lighting_class, note=note)
        return Group("route", judgement.name, (head, *facts_in(judgement)))
