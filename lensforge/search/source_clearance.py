"""Room for the source: whether the inner surface is kept clear of it, by the limits of the spec.

The search keeps the inner surface outside the cavity's paraboloid, and knows nothing of the source. A source that is
inside it is never touched; the smallest inner surface that the limits allow is the boundary where one is.
"""

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.ray_bundle import Source
from lensforge.sources.source_pose import SourcePose
from lensforge.spec import Spec
from lensforge.spec.feasible import smallest_inner_mm
from lensforge.spec.source_sections import Placement

_SLACK = 1e-6  # relative: rounding of a corner that lies on the boundary


def source_clearance_warnings(spec: Spec, source: Source) -> tuple[str, ...]:
    """Warn where the limits let the inner surface touch ``source``, the one of ``spec``.

    Raises :class:`InputError` for a source that was placed there, off the axis or above z = 0: its place or the limits
    are wrong. Nothing is said of a ray set: its rays need not start on the source.
    """
    if isinstance(spec.source, Placement):
        return ()
    above = _above_plane(source.outline())
    distance = np.linalg.norm(above, axis=1)
    polar = np.arctan2(np.hypot(above[:, 0], above[:, 1]), above[:, 2])
    smallest = smallest_inner_mm(spec.lens, spec.constraints)
    room = np.interp(polar, np.linspace(0.0, 0.5 * np.pi, len(smallest)), smallest) - distance
    if not len(room) or room.min() >= -_SLACK * distance.max():
        return ()
    x, y, z = above[room.argmin()]
    limits = spec.constraints
    kept = (
        "lens.fixed_inner"
        if spec.lens.fixed_inner is not None
        else f"the paraboloid of constraints.cavity_height_mm = {limits.cavity_height_mm:g} and cavity_radius_mm = "
        f"{limits.cavity_radius_mm:g}"
    )
    problem = (
        f"source: it reaches ({x:.4g}, {y:.4g}, {z:.4g}) mm, {np.hypot(x, y):.4g} mm from the axis, outside {kept}; "
        "only that is kept clear, and the lens may touch the source"
    )
    if SourcePose.of(spec.source).moves:
        raise InputError(f"{problem}; raise the limits, or change source.position_mm or tilt_deg")
    return (f"{problem}; raise the limits",)


def _above_plane(outline_mm: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "m 3"]:
    """Corners of the part of a polygon with z >= 0, those where its edges cross the plane z = 0 included."""
    found = [corner for corner in outline_mm if corner[2] >= 0.0]
    for one, other in zip(outline_mm, np.roll(outline_mm, -1, axis=0), strict=True):
        if one[2] * other[2] < 0.0:
            found.append(one + one[2] / (one[2] - other[2]) * (other - one))
    return np.array(found).reshape(-1, 3)
