"""Imported bodies in their poses: depth of points within them, their mirror symmetry, and how far they reach.

A body is star-shaped about its local origin, and ends in the local plane z = 0.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from lensforge.optics.media import SecondaryOptic
from lensforge.surfaces.mirror_group import group
from lensforge.surfaces.srbf import fibonacci_hemisphere

_DIRECTIONS = 4000  # in which bodies are compared: 2 degrees apart
_SAME = 1e-9  # rounding of a mirrored body

_Points = Float[np.ndarray, "n 3"]


def depths(body: SecondaryOptic, points: _Points, *, inner: bool) -> Float[np.ndarray, " n"]:
    """Depth (mm) of points within the inner or the outer face of a body; infinite below the plane in which it ends."""
    local = body.pose.to_local_points(points)
    face = body.inner if inner else body.outer
    radii = np.maximum(np.linalg.norm(local, axis=1), 1e-12)
    above = local[:, 2] > 0.0
    depth = np.full(len(points), np.inf)
    depth[above] = face.radius(local[above] / radii[above, None]) - radii[above]
    return depth


def outside_of(body: SecondaryOptic) -> _Points:
    """Points of the outer face of a body, in the coordinates of the lens."""
    u = fibonacci_hemisphere(_DIRECTIONS)
    return body.pose.points(body.outer.radius(u)[:, None] * u)


def has_mirrors(body: SecondaryOptic, symmetry: str) -> bool:
    """True if the posed body has the mirror group ``symmetry`` about the axis of the lens."""
    centre = np.array(body.pose.origin_mm)
    u = fibonacci_hemisphere(_DIRECTIONS // 10)
    for mirror in group(symmetry):
        local_mirror = body.pose.to_local_map(mirror)
        if not (
            np.allclose(mirror @ centre, centre, atol=_SAME)
            and np.allclose(local_mirror[2], [0.0, 0.0, 1.0], atol=_SAME)
        ):
            return False
        if not all(
            np.allclose(surface.radius(u), surface.radius(u @ local_mirror.T), rtol=_SAME)
            for surface in (body.inner, body.outer)
        ):
            return False
    return True


def reach_mm(bodies: Sequence[SecondaryOptic]) -> float:
    """Radius (mm) of the ball about the lens's origin that contains all bodies."""
    return max((float(np.linalg.norm(outside_of(body), axis=1).max()) for body in bodies), default=0.0)
