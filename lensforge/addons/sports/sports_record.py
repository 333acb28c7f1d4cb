"""Record of the light on a playing field."""

from typing import Annotated

from lensforge.results import Metric
from lensforge.results.figure import Figure
from lensforge.scene.application_light import ApplicationJudgement


class SportsJudgement(ApplicationJudgement):
    """Light of floodlights on one field. ``reached``: its best class of the same sport.

    ``mean_lx``, ``uniformity``: of the maintained horizontal illuminance. ``least_lx``: its smallest. ``glare``: rating
    of the eye that has the largest, of new lamps.
    """

    mean_lx: Metric
    uniformity: Metric
    least_lx: Annotated[Metric, Figure("Minimum illuminance", key="field_least_lx")]
    glare: Metric
