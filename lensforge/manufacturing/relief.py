"""Room for the ball around the base: near the rim it hangs below z = 0, where a flush base would be in its way."""

import numpy as np
from jaxtyping import Float

from lensforge.manufacturing.sampling import FaceSamples


def relief_step_mm(
    outer: FaceSamples, cutter_radius_mm: float, base_diameter_mm: float
) -> Float[np.ndarray, " k"]:
    """How far (mm) below z = 0 the base's top must lie for the ball to clear it at each sample; 0 where it is clear.

    The base is a disc of ``base_diameter_mm``; beside it the ball may go as low as it likes.
    """
    centres = outer.points + cutter_radius_mm * outer.normals
    beside = np.maximum(np.hypot(centres[:, 0], centres[:, 1]) - base_diameter_mm / 2.0, 0.0)
    below = np.sqrt(np.maximum(cutter_radius_mm**2 - beside**2, 0.0))
    return np.where(beside < cutter_radius_mm, np.maximum(below - centres[:, 2], 0.0), 0.0)


def hole_diameter_mm(inner: FaceSamples, cutter_radius_mm: float) -> float:
    """The smallest round hole (mm) through the base that lets the ball reach all of the cavity down to its rim."""
    centres = inner.points + cutter_radius_mm * inner.normals
    low = centres[:, 2] < cutter_radius_mm
    at_the_plane = np.sqrt(cutter_radius_mm**2 - np.maximum(centres[low, 2], 0.0) ** 2)
    reach = np.hypot(centres[low, 0], centres[low, 1]) + at_the_plane
    return 2.0 * float(reach.max(initial=0.0))
