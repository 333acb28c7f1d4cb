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

_LEFT_BY: Mapping[Registration, tuple[str, ...]] = {
    "none": ("shift_mm", "gap_mm", "tilt_deg"),
    "shift": ("tilt_deg",),
    "rigid": (),
}  # places that a registration leaves as they were measured
_X, _Y, _Z = range(3)
_SHIFTS = {"shift in x": ("shift_mm", _X), "shift in y": ("shift_mm", _Y), "shift in z": ("gap_mm", _Z)}
_TILTS = {"tilt about x": ("tilt_deg", _X), "tilt about y": ("tilt_deg", _Y)}
_UM = 1e3  # of a mm


def left_by(registration: Registration, places: Mapping[str, float]) -> dict[str, float]:
    """Those of the tolerances of ``places`` that can be judged after this ``registration``."""
    return {name: amount for name, amount in places.items() if name in _LEFT_BY[registration]}


def place_capabilities(
    motions: Sequence[RigidMotion], groups: Sequence[Sequence[int]], limits: Mapping[str, float]
) -> Iterator[PlaceCapability]:
    """Capability of each direction with a limit; ``motions``: that bring the parts of ``groups`` to their place.

    A direction that the points of a part do not determine, or in which no part differs from another, has none.
    """
    shifts = _UM * np.array([motion.pose.inverse.origin_mm for motion in motions])
    tilts = -np.degrees([motion.rotation_rad for motion in motions])
    shift_errors = _UM * np.array([motion.translation_error_mm for motion in motions])
    tilt_errors = np.degrees([motion.rotation_error_rad for motion in motions])
    for directions, values, errors, unit, factor in (
        (_SHIFTS, shifts, shift_errors, "µm", _UM),
        (_TILTS, tilts, tilt_errors, "deg", 1.0),
    ):
        for direction, (name, axis) in directions.items():
            differs = any(np.ptp(values[[*group], axis]) > 0.0 for group in groups)
            if name in limits and differs and np.isfinite(errors[:, axis]).all():
                yield _capability(direction, values[:, axis], errors[:, axis], groups, factor * limits[name], unit)


def _capability(
    direction: str,
    values: Float[np.ndarray, " p"],
    errors: Float[np.ndarray, " p"],
    groups: Sequence[Sequence[int]],
    limit: float,
    unit: str,
) -> PlaceCapability:
    by_group = [values[[*group]] for group in groups]
    worst = max(by_group, key=lambda group: abs(float(group.mean())))
    scatter = pooled(by_group, unit)
    return PlaceCapability(
        direction=direction,
        limit=limit,
        mean=Metric(value=float(worst.mean()), unit=unit, standard_error=float(scatter.value / np.sqrt(len(worst)))),
        scatter=scatter,
        part_error=float(np.sqrt(np.mean(errors**2))),
        cp=cp(2.0 * limit, scatter),
        cpk=cpk(by_group, limit, -limit),
    )
