"""Places at which a face cannot be made as designed: a map of what is in the way, and the worst place of each finding.

Places are samples of the face: they are known to the spacing of these.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float

from lensforge.cad.part_limits import ANGLE_TOLERANCE_DEG
from lensforge.cad.patch import Patch
from lensforge.cad.plan import Plan
from lensforge.shop.axis_tilt import free_tilt_deg
from lensforge.shop.ball_clearance import CustomBaseMesh, base_retreats
from lensforge.shop.check_measures import FaceFaults
from lensforge.shop.face_check import FaceCheck, MilledFace
from lensforge.shop.mould_halves import Moulding
from lensforge.spec import Spec

Places = dict[str, Float[np.ndarray, "3"]]
Samples = Bool[np.ndarray, " k"]


class Fault(IntEnum):
    """Obstacle at a node of a map; the last one if there are several."""

    NONE = 0
    STEEP = 1  # undercut farther than the axes of the machine tilt, or without the draft that a mould needs
    BASE = 2  # the base is in the ball's way
    TOOL = 3  # ball or turning tool does not reach
    UNDERCUT = 4  # neither half of the mould releases it


@dataclass(frozen=True)
class PartAround:
    """Surroundings of the faces of a lens of ``spec``: base or mould, None if absent."""

    spec: Spec
    plan: Plan[Patch] | None = None
    custom: CustomBaseMesh | None = None
    moulding: Moulding | None = None

    def faults(self, name: str, face: FaceCheck) -> FaceFaults | None:
        """Faults of the face ``name``; None if it has none."""
        scale = self.spec.manufacture.scale
        at_base = self._retreat_mm(face)
        undercut = self._undercut(name, face)
        kinds = np.zeros(len(face.samples.points))
        kinds[self._too_steep(name, face)] = Fault.STEEP
        kinds[at_base > 0.0] = Fault.BASE
        kinds[~(face.residual_mm <= 0.0)] = Fault.TOOL  # NaN where nothing is reached
        kinds[undercut] = Fault.UNDERCUT
        if not kinds.any():
            return None
        places = face.worst_places()
        if at_base.any():
            places["relief"] = face.samples.points[np.argmax(at_base)]
        if undercut.any():
            slant = np.abs(face.samples.upward)
            places["undercut"] = face.samples.points[np.argmax(np.where(undercut, slant, -1.0))]
            places["draft"] = face.samples.points[np.argmin(np.where(undercut, 2.0, slant))]  # of what is released
        return FaceFaults(
            face=name,
            places_mm={finding: tuple((point / scale).tolist()) for finding, point in places.items()},
            kinds=face.samples.grid.to_map(kinds),
        )

    def _too_steep(self, name: str, face: FaceCheck) -> Samples:
        """Samples with too little draft, or undercut farther than the axis of a mill tilts."""
        limits_deg = [self.spec.asked_draft_deg(name)]
        if isinstance(face, MilledFace) and self.spec.manufacture.cuts == "lens":
            limits_deg.append(-free_tilt_deg(face.samples, self.spec))
        least_deg = max((draft for draft in limits_deg if draft is not None), default=-90.0)
        draft_deg = np.degrees(np.arcsin(np.clip(face.samples.upward, -1.0, 1.0)))
        return np.asarray(draft_deg < least_deg - ANGLE_TOLERANCE_DEG)

    def _retreat_mm(self, face: FaceCheck) -> Float[np.ndarray, " k"]:
        """Largest length by which the base must be cut back for the ball; 0 if clear, or beyond the ball's reach."""
        if not isinstance(face, MilledFace):
            return np.zeros(len(face.samples.points))
        retreats = base_retreats(self.plan, self.custom, face).values()
        return np.where(face.reached, np.max([*retreats], axis=0) if retreats else 0.0, 0.0)

    def _undercut(self, name: str, face: FaceCheck) -> Samples:
        if self.moulding is None:
            return np.zeros(len(face.samples.points), dtype=bool)
        return self.moulding.undercut(name, face.samples.points / self.spec.manufacture.scale)


def faults_of(faces: Mapping[str, FaceCheck], part: PartAround) -> tuple[FaceFaults, ...]:
    """Faults of those ``faces`` that have any, in their order."""
    every = (part.faults(name, face) for name, face in faces.items())
    return tuple(faults for faults in every if faults is not None)
