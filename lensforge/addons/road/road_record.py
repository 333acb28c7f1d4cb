"""Records of the light on a road, as each driver sees it and as it is judged."""

from typing import Annotated

from lensforge.results import Count, Metric, NotNegative, Positive, Record, Text
from lensforge.results.figure import Figure
from lensforge.scene.application_light import ApplicationJudgement


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


class RoadJudgement(ApplicationJudgement):
    """Light of rows of lamps on one road. ``reached``: its best class M, C or P, by RP-8 all classes that it meets.

    ``drivers``: by their lanes. ``s1``: None for a table that ends before tan gamma = 2. ``edges``: ratio of the
    illuminance beside the road to that within, at the right and at the left edge. ``mean_lx``, ``least_lx``,
    ``uniformity_lx``: horizontal illuminance of the road. ``power_density`` (W per lx and m^2, D_P) and
    ``yearly_energy`` (kWh per m^2, AECI): None if the power of a lamp is not known.
    """

    surface: Annotated[Text, Figure("Surface", "Q0 {q0:3}, S1 {s1_words}")]
    q0: Positive
    s1: NotNegative | None
    drivers: tuple[SeenRoad, ...]
    edges: tuple[Metric, Metric]
    mean_lx: Annotated[Metric, Figure("Mean illuminance", key="road_lx")]
    least_lx: Annotated[Metric, Figure("Minimum illuminance", key="road_least_lx")]
    uniformity_lx: Metric
    power_density: Annotated[Metric | None, Figure("Power density D_P")]
    yearly_energy: Annotated[Metric | None, Figure("Annual energy D_E")]
    standard: Text = "EN 13201"

    @property
    def s1_words(self) -> str:
        """Display text of the surface's S1, or why it is not known."""
        too_short = "not known: its table ends before tan γ = 2; light from beyond is ignored"
        return too_short if self.s1 is None else f"{self.s1:.3g}"
