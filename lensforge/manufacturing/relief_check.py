"""Room for the cutter beside the base, whatever base it is."""

import numpy as np
from jaxtyping import Float

from lensforge.manufacturing.cut import InnerRelief, OuterRelief, OwnBaseRelief, Relief
from lensforge.manufacturing.face_check import FaceCheck
from lensforge.manufacturing.own_base import OwnBase
from lensforge.manufacturing.relief import bore_clearance_mm, relief_step_mm, step_clearance_mm
from lensforge.spec import BaseSection


def check_relief(
    base: BaseSection | None, own: OwnBase | None, cutter_mm: float, inner: FaceCheck, outer: FaceCheck
) -> Relief:
    """How far the base must retreat for the cutter, over the part of each face that the face itself lets it reach.

    ``base``: None for a mould insert; ``own``: the base from a STEP file, where ``base`` says so.
    """
    if base is None or base.kind == "none":
        note = "a mould insert has no base" if base is None else "there is no base"
        return Relief(outer=None, inner=None, note=note)
    if own is not None:
        return Relief(outer=_own(outer, own, cutter_mm), inner=_own(inner, own, cutter_mm))
    step = _missing_step(base, cutter_mm, outer)
    setback = step_clearance_mm(outer.samples, cutter_mm)
    setback = np.where(setback > base.relief_setback_mm, setback, 0.0)
    clearance = bore_clearance_mm(inner.samples, cutter_mm)
    return Relief(
        outer=OuterRelief(
            smallest_step_mm=_largest_reached(outer, step),
            step_clearance_mm=_largest_reached(outer, setback),
            flush_fraction=_clear(outer, np.maximum(step, setback)),
        ),
        inner=InnerRelief(
            bore_clearance_mm=_largest_reached(inner, clearance), flush_fraction=_clear(inner, clearance)
        ),
    )


def _missing_step(base: BaseSection, cutter_mm: float, outer: FaceCheck) -> Float[np.ndarray, " k"]:
    """The step that each sample wants, flange included; 0 where the one that there is will do."""
    step = relief_step_mm(outer.samples, cutter_mm, base.widest_mm) - base.relief_step_mm
    if base.flange_diameter_mm is not None:
        shoulder = base.height_mm - base.flange_height_mm
        step = np.maximum(step, relief_step_mm(outer.samples, cutter_mm, base.flange_diameter_mm) - shoulder)
    return np.where(step > 0.0, step + base.relief_step_mm, 0.0)


def _own(face: FaceCheck, own: OwnBase, cutter_mm: float) -> OwnBaseRelief:
    retreat = own.retreat_mm(face.samples, cutter_mm)
    return OwnBaseRelief(retreat_mm=_largest_reached(face, retreat), flush_fraction=_clear(face, retreat))


def _largest_reached(face: FaceCheck, retreat: Float[np.ndarray, " k"]) -> float | None:
    return float(retreat[face.reached].max()) if face.reached.any() else None


def _clear(face: FaceCheck, retreat: Float[np.ndarray, " k"]) -> float:
    return face.samples.fraction(face.reached & (retreat == 0.0))
