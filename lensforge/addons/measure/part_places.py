"""Places of a face on several parts, against datums, and the capability of each direction in which they are toleranced.

A spec states an amount either way in x and in y, not a circle about the axis: each direction is a figure of its own
(ISO 22514-2), and no capability of several together is asked for (ISO 22514-6). Tilts are about the lens's origin.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from lensforge.addons.measure.capability import cp, cpk, pooled
from lensforge.addons.measure.measurement_result import Registration
from lensforge.addons.measure.part_series import PlaceCapability
from lensforge.addons.measure.registration import RigidMotion
from lensforge.results import Metric
from lensforge.spec.tolerances_section import PLACEMENT

# Places that a registration leaves as they were measured.
_LEFT_BY: dict[Registration, tuple[str, ...]] = {"none": PLACEMENT, "shift": ("tilt_deg",), "rigid": ()}
_DIRECTIONS = {
    "shift in x": "shift_mm", "shift in y": "shift_mm", "shift in z": "gap_mm",
    "tilt about x": "tilt_deg", "tilt about y": "tilt_deg",
}  # fmt: skip
_UM = 1e3  # of a mm


def left_by(registration: Registration, places: Mapping[str, float]) -> dict[str, float]:
    """Take those tolerances of ``places`` that can be judged after this ``registration``."""
    return {name: amount for name, amount in places.items() if name in _LEFT_BY[registration]}


def place_capabilities(
    motions: Sequence[RigidMotion], groups: Sequence[Sequence[int]], limits: Mapping[str, float]
) -> Iterator[PlaceCapability]:
    """Capability of each direction with a limit; ``motions``: that bring the parts of ``groups`` to their place.

    A direction that the points of a part do not determine, or in which no part differs from another, has none.
    """
    shifts = [[*motion.pose.inverse.origin_mm, *-motion.rotation_rad[:2]] for motion in motions]
    errors = [[*motion.translation_error_mm, *motion.rotation_error_rad[:2]] for motion in motions]
    units = np.array([_UM, _UM, _UM, np.degrees(1.0), np.degrees(1.0)])
    columns = zip(_DIRECTIONS.items(), (units * shifts).T, (units * errors).T, strict=True)
    for (direction, name), values, wrong in columns:
        by_group = [values[[*group]] for group in groups]
        if name in limits and np.isfinite(wrong).all() and any(np.ptp(group) > 0.0 for group in by_group):
            yield _capability(direction, by_group, wrong, limits[name])


def _capability(
    direction: str, by_group: Sequence[Float[np.ndarray, " _"]], errors: Float[np.ndarray, " p"], amount: float
) -> PlaceCapability:
    unit = "deg" if direction.startswith("tilt") else "µm"
    limit = amount if unit == "deg" else _UM * amount
    worst = max(by_group, key=lambda group: abs(float(group.mean())))
    scatter = pooled(by_group, unit)
    error = scatter.value / len(worst) ** 0.5
    return PlaceCapability(
        direction=direction,
        limit=limit,
        mean=Metric(value=float(worst.mean()), unit=unit, standard_error=error),
        scatter=scatter,
        part_error=float(np.sqrt(np.mean(errors**2))),
        cp=cp(2.0 * limit, scatter),
        cpk=cpk(by_group, limit, -limit),
    )
