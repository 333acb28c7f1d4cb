"""The result of a correction: the STEP file for the second cut, and the errors before and after it."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.cad.part import FileStamp, SplineNodes
from lensforge.cad.part_limits import FORM_LIMIT_NM, NORMAL_LIMIT_MRAD, ROUND_TRIP_LIMIT
from lensforge.light.evaluation_result import LightMetrics
from lensforge.made.measurement_result import Pose, Registration, Side, surface_criteria
from lensforge.results import (
    Array,
    Count,
    Extent,
    Flag,
    InFile,
    NotNegative,
    Positive,
    Record,
    Share,
    SimulatedResult,
)
from lensforge.results.criteria import Criterion, at_least, at_most
from lensforge.surfaces.step_file import Schema

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# A hollow tighter than the ball by this share, as wide as 2 mm, stays 0.1 um uncut by a ball of 1 mm.
KEPT = 1e-3
_STEP_FILE = "lens_corrected.step"  # of the outer face: lens_corrected_outer.step

FaceMap = Annotated[Float[np.ndarray, "m m"], Array("m", "m", gaps=True)]


class CutterLimit(Record):
    """The ball cutter's limit on a correction; radii are the smallest concave ones, None where there is none.

    ``smoothed_more_share``: of the area, where the wavelength was made longer for the cutter; ``cut_back_um``: how much
    of the correction that took away, along the normal.
    """

    cutter_radius_mm: Positive
    concave_radius_before_mm: Positive | None
    concave_radius_mm: Positive | None
    smoothed_more_share: Share
    cut_back_um: Extent


class Correction(SimulatedResult):
    """A face corrected by the mirrored deviation of a first cut, in a STEP file for the second one.

    ``deviation_um``: of the first cut as far as its points show it, along the normal; ``correction_um``: that was put
    into the STEP; ``expected_um``: of the second cut, where the machine errs again as in the first. Extents are over
    the area of the face, ``residual_rms_um`` is what the filter of ``wavelength_mm`` leaves of the points: their noise
    and form of shorter waves; ``noise_rms_um``: of the points. Maps over the chart are [Y, X], NaN outside.
    The STEP and all lengths are in the lens's own size, but the radii of ``cutter``: they are of the face that is cut,
    ``scale`` times as large, 1 + shrinkage for a mould insert. ``step_volume_change``: relative, by reading back."""

    stage: ClassVar[str] = "correct"
    command: ClassVar[str] = "correct --points"

    surface: Side
    registration: Registration
    make: Literal["part", "insert"]
    scale: Positive
    point_count: Count
    point_spacing_mm: Positive
    used_share: Share
    covered_share: Share
    pose: Pose
    gain: Positive
    wavelength_mm: Positive
    wavelength_given: Flag
    noise_rms_um: NotNegative
    residual_rms_um: NotNegative
    deviation_um: Extent
    correction_um: Extent
    expected_um: Extent
    cutter: CutterLimit
    nodes: SplineNodes
    step_schema: Schema
    step_volume_change: NotNegative
    form_error_nm: Extent
    normal_error_mrad: Extent
    rays: Count
    design: LightMetrics
    first_cut: LightMetrics
    second_cut: LightMetrics
    change: LightMetrics
    criteria: tuple[Criterion, ...]
    file: FileStamp
    chart: Annotated[Float[np.ndarray, " m"], Array("m", centred=True)]
    area_mm2: FaceMap
    deviation_map_um: FaceMap
    correction_map_um: FaceMap
    expected_map_um: FaceMap
    step: Annotated[bytes, InFile(_STEP_FILE), Field(strict=True, repr=False)]

    def products(self) -> dict[str, bytes]:
        """STEP by suffix."""
        return {".step": self.step, ".stp": self.step}

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Plot the correction over the chart of the surface."""
        from lensforge.results.plots import plot_face

        return plot_face(self.correction_map_um.T, float(self.chart[-1]), f"{self.surface}: correction (µm)", axes)


def correction_criteria(
    used: float, covered: float, form_nm: float, normal_mrad: float, volume_change: float, cutter: CutterLimit
) -> tuple[Criterion, ...]:
    """Criteria on a correction: its points, the written STEP as read back, and the reach of the cutter.

    Where the design is concave more tightly than the cutter already, the correction must not make it tighter.
    """
    longer = "take a longer wavelength_mm"
    found = (
        *surface_criteria(used, covered),
        at_most("form_error", form_nm, FORM_LIMIT_NM, "nm", longer),
        at_most("normal_error", normal_mrad, NORMAL_LIMIT_MRAD, "mrad", longer),
        at_most("step_volume_change", volume_change, ROUND_TRIP_LIMIT, "", longer),
    )
    if cutter.concave_radius_mm is None:
        return found
    before = cutter.concave_radius_before_mm
    least = min(cutter.cutter_radius_mm, np.inf if before is None else before) * (1.0 - 2.0 * KEPT)
    return (*found, at_least("concave_radius", cutter.concave_radius_mm, least, "mm", longer))
