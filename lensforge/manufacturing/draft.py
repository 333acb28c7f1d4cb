"""Draft for moulding and tilt for milling: how a face leans against the optical axis, which is the pull direction.

The outer face is pulled along +z and the cavity's core along -z; since their air-side normals are opposite too, the
same formula with the outward normal serves both: ``draft = asin(n . z)``. A negative draft is an undercut.
"""

import numpy as np
from jaxtyping import Float

from lensforge.manufacturing.sampling import FaceSamples

_UNDERCUT = 1e-9  # a hemisphere's rim has n.z = 0 up to rounding, which is not an undercut


def draft_rad(samples: FaceSamples) -> Float[np.ndarray, " k"]:
    """Draft angle (rad) at each sample: pi/2 at the apex, 0 at the rim of a hemisphere, negative in an undercut."""
    draft: Float[np.ndarray, " k"] = np.arcsin(np.clip(samples.outward[:, 2], -1.0, 1.0))
    return draft


def undercut_fraction(samples: FaceSamples) -> float:
    """The part of the area that neither a two-part mould nor an untilted cutter reaches along the axis."""
    return samples.fraction(samples.outward[:, 2] < -_UNDERCUT)


def largest_tilt_rad(samples: FaceSamples) -> float:
    """Largest angle (rad) between the face's normal and the axis: the tilt of a five-axis head that stays normal."""
    return float(np.pi / 2.0 - draft_rad(samples).min())
