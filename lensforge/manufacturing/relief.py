"""Room for the ball around the base: near the rim it hangs below z = 0, where the base may be in its way.

The base is a disc below z = 0 with a bore drawn straight down from the cavity's rim. Both measures say how far that
material must retreat for the ball to touch a sample: down, below the outer face; sideways, around the bore.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.manufacturing.face import OpticalFace
from lensforge.manufacturing.sampling import FaceSamples

# A retreat of 1 nm is none: at the rim of a hemisphere the ball touches the bore's wall exactly.
_CLEAR_MM = 1e-6
_RIM_POINTS = 4096


def relief_step_mm(outer: FaceSamples, cutter_radius_mm: float, base_diameter_mm: float) -> Float[np.ndarray, " k"]:
    """How far (mm) below z = 0 the base's top must lie for the ball to clear it at each sample; 0 where it is clear.

    Beside the disc of ``base_diameter_mm`` the ball may go as low as it likes.
    """
    centres = outer.points + cutter_radius_mm * outer.normals
    beside = np.maximum(np.hypot(centres[:, 0], centres[:, 1]) - base_diameter_mm / 2.0, 0.0)
    below = np.sqrt(np.maximum(cutter_radius_mm**2 - beside**2, 0.0))
    step = np.where(beside < cutter_radius_mm, below - centres[:, 2], 0.0)
    return np.where(step > _CLEAR_MM, step, 0.0)


def bore_clearance_mm(inner: FaceSamples, cutter_radius_mm: float) -> Float[np.ndarray, " k"]:
    """How much wider (mm) all around than the cavity's rim the bore must be for the ball to touch each sample.

    For samples that the ball reaches in the cavity itself. There a centre above z = 0 is at least R from the rim
    already; one below, where the cavity narrows upwards, has its full width R against the wall of the bore.
    """
    return _clearance_mm(inner, cutter_radius_mm)


def step_clearance_mm(outer: FaceSamples, cutter_radius_mm: float) -> Float[np.ndarray, " k"]:
    """How far (mm) the wall of a relief step must stand back from the outer rim for the ball to touch each sample.

    0 where a wall drawn straight down from the rim will do; above it near a rim that is undercut.
    """
    return _clearance_mm(outer, cutter_radius_mm)


def _clearance_mm(face: FaceSamples, cutter_radius_mm: float) -> Float[np.ndarray, " k"]:
    """How much of the ball's width is in a wall below the face's rim; none of it for a centre above z = 0."""
    centres = face.points + cutter_radius_mm * face.normals
    low = centres[:, 2] < 0.0
    clearance = np.zeros(len(centres))
    if low.any():
        clearance[low] = cutter_radius_mm - _distance_to_rim(face.face, centres[low, :2])
    return np.where(clearance > _CLEAR_MM, clearance, 0.0)


def _distance_to_rim(face: OpticalFace, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """Distance (mm) in the plane z = 0 to the face's rim."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, _RIM_POINTS, endpoint=False)
    circle = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    distance, _ = cKDTree(face.radius(circle)[:, None] * circle).query(points)
    nearest: Float[np.ndarray, " n"] = distance
    return nearest
