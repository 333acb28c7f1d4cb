"""Figures by which lighting is bought: candela on the axis, beam and field angles, each with its standard error.

Angles are read from the table that the files hold. The level at which they are read, a half or a tenth of the largest
intensity of the plane, has the noise of the rays taken off: the largest of many noisy numbers is too large. A standard
error has three parts: by the independent samples of the rays, by that of the level, and by interpolation: what a table
of half the steps changes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from lensforge.evaluation.minimum import largest_without_noise
from lensforge.far_field.resolution import FittedIntensity
from lensforge.jackknife import jackknife_error
from lensforge.records import Metric, Number, Record
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric.beam import BEAM_SHARE, FIELD_SHARE, plane_profile, width_above
from lensforge.sources.photometric.orientation import turned_over

PLANES_DEG = (0.0, 90.0)  # C 0 - C 180 and C 90 - C 270


class Direction(Record):
    """A direction of the table: half-plane C and angle gamma from the axis (deg)."""

    c_deg: Number
    gamma_deg: Number


class PlaneFigures(Record):
    """Beam in the plane of the half-planes ``c_deg`` and ``c_deg`` + 180.

    ``beam_angle_deg`` and ``field_angle_deg``: between the outermost directions with a half and a tenth of the largest
    intensity of this plane, ``peak_cd`` (CIE S 017, ANSI/IES LS-1); None where it has no light.
    """

    c_deg: Number
    peak_cd: Metric
    beam_angle_deg: Metric | None
    field_angle_deg: Metric | None


@dataclass(frozen=True)
class CandelaTables:
    """Intensities (cd) in the frame of the files: of all rays, and with one of the independent samples left out each.

    ``samples``: of each sample alone, with values below 0 where they have noise. ``finer``: of all, in half the steps.
    """

    whole: TabulatedIntensity
    left_out: Sequence[TabulatedIntensity]
    samples: Float[np.ndarray, "p c g"]
    finer: TabulatedIntensity

    @staticmethod
    def of(light: FittedIntensity, per_watt: float) -> "CandelaTables":
        """Tables of ``light``; ``per_watt``: lumens of a watt of the source."""
        values, count = light.samples * per_watt, len(light.samples)
        total = values.sum(axis=0)
        rest = [(total - one) / (count - 1) for one in values] if count > 1 else []
        left_out = [turned_over(light.grid.table(each)) for each in rest if each.sum() > 0.0]
        closed = np.concatenate([values, values[:, :1]], axis=1)[:, ::-1]
        finer = turned_over(replace(light.finer, values=light.finer.values * per_watt))
        return CandelaTables(turned_over(light.grid.table(total / count)), left_out, closed, finer)

    def figure(self, read: Callable[[TabulatedIntensity], float], unit: str, most: float = np.inf) -> Metric:
        """Figure that ``read`` takes from a table, with its standard error; None of that from fewer than two samples.

        ``most``: the largest error that interpolation can make; beyond it, the finer table differs by its noise.
        """
        value = read(self.whole)
        if len(self.left_out) < 2:
            return Metric(value=value, unit=unit)
        by_rays = jackknife_error(np.array([read(table) for table in self.left_out]))
        by_steps = min(abs(read(self.finer) - value), most)
        return Metric(value=value, unit=unit, standard_error=float(np.hypot(by_rays, by_steps)))

    @cached_property
    def peak_direction(self) -> Direction:
        """Node with the largest intensity; on the axis, where all half-planes meet, that of C = 0."""
        plane, angle = np.unravel_index(int(np.argmax(self.whole.values)), self.whole.values.shape)
        c_deg = float(self.whole.c_deg[plane]) % 360.0 if angle > 0 else 0.0
        return Direction(c_deg=c_deg, gamma_deg=float(self.whole.gamma_deg[angle]))

    @property
    def axis_cd(self) -> Metric:
        """Intensity on the axis."""
        return self.figure(lambda table: float(table.values[0, 0]), "cd")

    def plane(self, c_deg: float) -> PlaneFigures:
        """Beam in the plane of C = ``c_deg`` and its opposite."""
        profiles = np.stack([plane_profile(self._with(sample), c_deg)[1] for sample in self.samples])
        peak = largest_without_noise(profiles)
        return PlaneFigures(
            c_deg=c_deg,
            peak_cd=peak.model_copy(update={"unit": "cd"}),
            beam_angle_deg=self._angle(c_deg, peak, BEAM_SHARE),
            field_angle_deg=self._angle(c_deg, peak, FIELD_SHARE),
        )

    @property
    def _step_deg(self) -> float:
        """Step of gamma in the beam: the ends of a width are each known to a step."""
        return float(self.whole.gamma_deg[1] - self.whole.gamma_deg[0])

    @property
    def _span_deg(self) -> float:
        """Angle between the table's ends: no width errs by more, where lobes come and go with the noise."""
        return 2.0 * float(self.whole.gamma_deg[-1])

    def _with(self, values: Float[np.ndarray, "c g"]) -> TabulatedIntensity:
        return TabulatedIntensity(self.whole.c_deg, self.whole.gamma_deg, values)

    def _angle(self, c_deg: float, peak: Metric, share: float) -> Metric | None:
        """Width of the beam at ``share`` of its ``peak``, whose own error is a part of that of the width."""

        def width(table: TabulatedIntensity, level: float) -> float:
            return width_above(*plane_profile(table, c_deg), level) or 0.0

        found = self.figure(lambda table: width(table, share * peak.value), "°", 2.0 * self._step_deg)
        if not found.value > 0.0:
            return None
        if found.standard_error is None or peak.standard_error is None:
            return found
        lowest, highest = peak.value - peak.standard_error, peak.value + peak.standard_error
        wide = width(self.whole, share * lowest) if lowest > 0.0 else self._span_deg  # all of the table is brighter
        narrow = width(self.whole, share * highest)
        error = min(float(np.hypot(found.standard_error, 0.5 * (wide - narrow))), self._span_deg)
        return found.model_copy(update={"standard_error": error})
