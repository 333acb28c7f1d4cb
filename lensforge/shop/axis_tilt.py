"""Tilt of the axis of a mill at a face: what reaches all of it, and what the machine and a cavity's mouth leave.

A ball cuts up to its equator: an axis need not tilt farther from the lens axis than the face is undercut, towards the
side of its normal. In a cavity the shank, as thick as the ball, leaves by the mouth.
"""

import numpy as np

from lensforge.shop.face_samples import AirSide, FaceSamples, least_draft_rad
from lensforge.spec import Spec
from lensforge.spec.part_section import mouth_room_deg

_AZIMUTHS = 2048


def needed_tilt_deg(samples: FaceSamples) -> float:
    """Least tilt (degrees) by which an axis reaches all of the face."""
    return max(0.0, -float(np.degrees(least_draft_rad(samples))))


def free_tilt_deg(samples: FaceSamples, spec: Spec) -> float:
    """Largest tilt (degrees) that machine and mouth leave at a face of a lens of ``spec`` that is milled itself.

    In a cavity that of a tool on the lens axis, at the height of the highest ball that touches an undercut place: a
    tool at the wall, which leans towards the lens axis, has more room. None in a hollow that widens upwards, and if the
    bore below is not known.
    """
    shop = spec.manufacture
    if samples.face.air is AirSide.OUTSIDE:
        return shop.max_tilt_deg
    depth_mm = spec.bore_depth_mm
    if depth_mm is None or samples.face.sense < 0:
        return 0.0
    heights_mm = (samples.points + shop.cutter_radius_mm * samples.normals)[samples.upward < 0.0, 2]
    turn = np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS, endpoint=False)
    mouth_mm = samples.face.rim_mm(np.stack([np.cos(turn), np.sin(turn)], axis=-1)).min()
    above_mm = depth_mm + heights_mm.max(initial=0.0)
    return min(mouth_room_deg(float(mouth_mm), float(above_mm), shop.cutter_radius_mm), shop.max_tilt_deg)
