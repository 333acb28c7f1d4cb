"""Where measured rays come to lie: from the coordinates of their file to those of the lens."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.bundle import RayBundle
from lensforge.sources.rayfiles.virtual_focus import virtual_focus
from lensforge.spec.source import Placement

# Proper rotations that take the named direction of the file to +z.
_TO_LENS_AXIS = {
    "+x": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
    "-x": ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0)),
    "+y": ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "-y": ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
    "+z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "-z": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
}
_MIRROR = {"none": (1.0, 1.0, 1.0), "x": (-1.0, 1.0, 1.0), "y": (1.0, -1.0, 1.0)}


def placed(rays: RayBundle, origin: Float[np.ndarray, " 3"], spec: Placement) -> RayBundle:
    """``rays`` of a file in lens coordinates; ``origin`` (mm, in the file) becomes the lens origin."""
    matrix = _rotation_z(np.deg2rad(spec.rotate_z_deg)) @ np.diag(_MIRROR[spec.mirror]) @ _TO_LENS_AXIS[spec.axis]
    return replace(rays, origins=spec.scale * (rays.origins - origin) @ matrix.T, directions=rays.directions @ matrix.T)


def origin_of(rays: RayBundle, spec: Placement, name: str) -> Float[np.ndarray, " 3"]:
    """The point (mm) of the file ``name`` that ``spec`` wants at the lens origin."""
    if spec.origin == "file":
        return np.zeros(3)
    if spec.origin != "virtual_focus":
        return np.array(spec.origin, dtype=np.float64)
    focus = virtual_focus(rays.origins, rays.directions, rays.weights)
    if focus is None:
        raise InputError(f"{name}: its rays are parallel and have no virtual focus; give source.origin as a point")
    return focus


def _rotation_z(angle: float) -> Float[np.ndarray, "3 3"]:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
