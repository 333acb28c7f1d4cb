"""Light of a lamp on areas and roads: classes of EN 13201 of a straight road lit from one side, and what drivers see.

Illuminance (P, C) and glare (G*) classes: EN 13201-2:2015, tables 2, 4 and A.1. Points and lamps: EN 13201-3:2015,
clause 7: between two lamps, ten points along (or as many as keep them 3 m apart), at least three across (1.5 m); all
lamps within five heights count.
"""

from dataclasses import dataclass
from math import ceil
from typing import Literal

import numpy as np
from jaxtyping import Float

from lensforge.light.evaluation_result import LimitResult
from lensforge.light.luminaire_classes import BugRating, DistributionType, LampLight, ZoneLumens, distribution_type
from lensforge.light.metrics import (
    jackknife_metric,
    largest_without_noise,
    least_over_mean,
    least_without_noise,
    scaled,
)
from lensforge.results import Count, Metric, Positive, Record, Text
from lensforge.spec.light_limits import PhotometrySection
from lensforge.spec.road_section import C_CLASSES, C_UNIFORMITY, P_CLASSES, P_MOST

_NONE = "none"
# Most candela per 1000 lm of the lamp at and above 70, 80 and 90 degrees.
_G = {
    "G*6": (350.0, 100.0, 0.0),
    "G*5": (350.0, 100.0, 10.0),
    "G*4": (500.0, 100.0, 10.0),
    "G*3": (np.inf, 100.0, 20.0),
    "G*2": (np.inf, 150.0, 30.0),
    "G*1": (np.inf, 200.0, 50.0),
}
_POINTS_ALONG, _SPACING_M, _ACROSS_M, _LEAST_ACROSS = 10, 3.0, 1.5, 3
_WITHIN_HEIGHTS = 5.0


class GlareIntensities(Record):
    """Largest intensity (cd per 1000 lm of the lamp) at and above 70 and 80 degrees; a lens sends none above 90.

    ``glare_class``: the strictest class of glare that these keep, or "none".
    """

    above_70: Metric
    above_80: Metric
    glare_class: Text


class RoadLighting(Record):
    """Illuminance (lx) on the road between two lamps, and the best classes that it reaches.

    ``mean_lx``, ``least_lx``: over ``points``; ``uniformity``: least over mean (U0). ``p_class`` and ``c_class``:
    "none" where no class is reached. ``lamps``: that light some of the points.
    """

    mean_lx: Metric
    least_lx: Metric
    uniformity: Metric
    p_class: Text
    c_class: Text
    points: Count
    lamps: Count


def glare_intensities(lamp: LampLight, lumens: float) -> GlareIntensities:
    """Largest intensities of ``lamp`` near the horizon, without the noise that would choose them."""
    above_70, above_80 = (_largest_from(lamp, gamma, 1000.0 / lumens) for gamma in (70.0, 80.0))
    keeps = (
        name for name, (at_70, at_80, _) in _G.items() if above_70.value <= at_70 and above_80.value <= at_80
    )  # nothing shines at 90 degrees and above
    return GlareIntensities(above_70=above_70, above_80=above_80, glare_class=next(keeps, _NONE))


def _largest_from(lamp: LampLight, gamma_deg: float, scale: float) -> Metric:
    nodes = np.append(gamma_deg, lamp.grid.gamma_deg[lamp.grid.gamma_deg > gamma_deg])
    lateral, gamma = (each.ravel() for each in np.meshgrid(lamp.grid.c_deg - lamp.street_deg, nodes, indexing="ij"))
    found = largest_without_noise(scale * lamp.intensities(lateral, gamma))
    return found.model_copy(update={"value": max(found.value, 0.0), "unit": "cd/klm"})


@dataclass(frozen=True)
class _Road:
    """Points on the road, and lamps along its edge (m): x along the road, y across it from that edge."""

    x: Float[np.ndarray, " k"]
    y: Float[np.ndarray, " k"]
    lamps_x: Float[np.ndarray, " l"]
    lamp_y: float
    height_m: float

    @staticmethod
    def of(section: PhotometrySection) -> "_Road":
        """Points of one field between the lamps at x = 0 and at x = the spacing."""
        height, spacing, width = section.pole_height_m, section.pole_spacing_m, section.road_width_m
        assert height is not None and spacing is not None and width is not None
        along = max(_POINTS_ALONG, ceil(spacing / _SPACING_M))
        across = max(_LEAST_ACROSS, ceil(width / _ACROSS_M))
        x, y = np.meshgrid((np.arange(along) + 0.5) * spacing / along, (np.arange(across) + 0.5) * width / across)
        reach = ceil(_WITHIN_HEIGHTS * height / spacing)
        lamps = np.arange(-reach, reach + 2) * spacing
        return _Road(x.ravel(), y.ravel(), lamps, section.overhang_m, height)

    def illuminance(self, lamp: LampLight) -> tuple[Float[np.ndarray, "p k"], int]:
        """Illuminance (lx) at every point by each sample, and the number of lamps that light any of them."""
        total, counted = np.zeros((len(lamp.samples), len(self.x))), 0
        for lamp_x in self.lamps_x:
            along, across = self.x - lamp_x, self.y - self.lamp_y
            away = np.hypot(along, across)
            near = away <= _WITHIN_HEIGHTS * self.height_m
            if not near.any():
                continue
            counted += 1
            gamma = np.arctan2(away[near], self.height_m)
            lateral = np.rad2deg(np.arctan2(along[near], across[near]))
            light = lamp.intensities(lateral, np.rad2deg(gamma))
            total[:, near] += light * np.cos(gamma) ** 3 / self.height_m**2
        return total, counted


def road_lighting(lamp: LampLight, section: PhotometrySection) -> RoadLighting:
    """Light on the road of ``section`` by a row of ``lamp``."""
    road = _Road.of(section)
    samples, lamps = road.illuminance(lamp)
    samples = samples * section.maintenance_factor
    means = samples.mean(axis=1)
    mean = jackknife_metric(means, float, "lx")
    least = least_without_noise(samples).model_copy(update={"unit": "lx"})
    uniformity = least_over_mean(samples).metric()
    return RoadLighting(
        mean_lx=mean,
        least_lx=least,
        uniformity=uniformity,
        p_class=p_class(mean.value, least.value),
        c_class=c_class(mean.value, uniformity.value),
        points=len(road.x),
        lamps=lamps,
    )


def p_class(mean_lx: float, least_lx: float) -> str:
    """Best P class of this mean and least illuminance; "none" where the mean exceeds 1.5 times all that are met."""
    met = (name for name, (mean, least) in P_CLASSES.items() if mean <= mean_lx <= P_MOST * mean and least_lx >= least)
    return next(met, _NONE)


def c_class(mean_lx: float, uniformity: float) -> str:
    """Best C class of this mean illuminance and its uniformity."""
    met = (name for name, mean in C_CLASSES.items() if mean_lx >= mean and uniformity >= C_UNIFORMITY)
    return next(met, _NONE)


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
        lumens = scaled(lens_lm, float(section.lenses), "lm")
        return RoadFigures(
            use=section.use,
            lumens=lumens,
            distribution=distribution,
            bug=BugRating.of(ZoneLumens.of(zones_lm * section.lenses), symmetric=distribution.lateral == "V"),
            glare=glare_intensities(lamp, lumens.value),
            road=road_lighting(lamp, section) if section.use == "road" else None,
        )


class SeenRoad(Record):
    """Road as the driver in one ``lane`` sees it, counted from the side on which one drives.

    ``mean_cd_per_m2``, ``uniformity`` (U0, least over mean), ``uniformity_along`` (Ul, least over largest on the middle
    of the lane), ``glare_percent`` (threshold increment TI, of new lamps). ``luminance_per_lux``: mean luminance over
    mean illuminance of the road (cd/m^2 per lx), Q.

    By RP-8 one of each direction of travel, whose first lane ``lane`` is: ``uniformity_along`` is least over largest of
    all its points, and glare ``veiling_ratio``, the largest veiling luminance over the mean.
    """

    lane: Count
    mean_cd_per_m2: Metric
    uniformity: Metric
    uniformity_along: Metric
    glare_percent: Metric | None
    luminance_per_lux: Metric
    veiling_ratio: Metric | None = None


class RoadJudgement(Record):
    """Light of a row of lamps on one road. ``limits``: what its ``lighting_class`` asks, each judged.

    ``reached``: the best class M of the figures, by RP-8 all classes that they have; "none" below all. ``drivers``: by
    their lanes.
    ``edges``: ratio of the illuminance beside the road to that within, at the right and at the left edge. ``mean_lx``,
    ``least_lx``, ``uniformity_lx``: horizontal illuminance of the road. ``power_density`` (W per lx and m^2, D_P) and
    ``yearly_energy`` (kWh per m^2, AECI): None where the power of a lamp is not known.
    """

    name: Text
    lighting_class: Text
    reached: Text
    surface: Text
    q0: Positive
    s1: Positive
    drivers: tuple[SeenRoad, ...]
    edges: tuple[Metric, Metric]
    mean_lx: Metric
    least_lx: Metric
    uniformity_lx: Metric
    power_density: Metric | None
    yearly_energy: Metric | None
    limits: tuple[LimitResult, ...]
    standard: Text = "EN 13201"


@dataclass(frozen=True)
class HeldSpacing:
    """Spacings (m) of poles at which a class is held, from ``least`` to ``largest``; ``beyond``: what is missed there.

    ``beyond``: None where the largest is 12 pole heights, the most that a road may have.
    """

    least: float
    largest: float
    beyond: LimitResult | None
