"""A face as it was given: the surface, where it comes from, and how far the surface is from it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.surfaces.surface import Surface

# Files between the process that samples a CAD face and the one that asks for it.
JOB, FOUND, SPLINE = "job.json", "found.json", "spline.npz"


@dataclass(frozen=True)
class GivenFace:
    """``surface``, ``origin`` in words, and its largest errors against what was given: nm along the normal, urad.

    ``unit``: that of the file.
    """

    surface: Surface
    origin: str
    form_error_nm: float
    normal_error_urad: float
    unit: str = "mm"


def place_of(direction: Float[np.ndarray, "3"]) -> str:
    """A direction from the origin in words."""
    polar = np.degrees(np.arccos(np.clip(direction[2], -1.0, 1.0)))
    azimuth = np.degrees(np.arctan2(direction[1], direction[0])) % 360.0
    return f"{polar:.1f} degrees from the axis at azimuth {azimuth:.0f} degrees"
