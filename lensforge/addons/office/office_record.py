"""Record of the glare of lamps in an office."""

from typing import Annotated

from lensforge.results import Metric
from lensforge.results.figure import Figure
from lensforge.scene.application_light import ApplicationJudgement


class OfficeJudgement(ApplicationJudgement):
    """Light of lamps in one office. ``reached``: its best class by both ratings.

    ``crosswise``, ``endwise``: unified glare rating seen along x and along y of the lamps. ``background_cd_per_m2``:
    luminance of the walls by reflected light. ``mean_lx``, ``uniformity``: of the direct light on the working plane;
    None without a pitch of the lamps.
    """

    crosswise: Metric
    endwise: Metric
    background_cd_per_m2: Annotated[Metric, Figure("Background", "luminance of the walls by reflected light")]
    mean_lx: Annotated[Metric | None, Figure("Mean illuminance", "direct, on the working plane", key="office_lx")] = (
        None
    )
    uniformity: Annotated[Metric | None, Figure("Uniformity U0", "of that light", key="office_u0")] = None
