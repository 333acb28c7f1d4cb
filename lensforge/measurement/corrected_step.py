"""STEP file of a lens with one corrected face, its errors measured by reading it back."""

from dataclasses import dataclass

from lensforge.geometry.base_profile import INNER, OUTER
from lensforge.geometry.custom_base import join_base, read_custom_base
from lensforge.geometry.cutter_room import base_with_room
from lensforge.geometry.form import FormError, face_error, fit_to_form, worst
from lensforge.geometry.part import SplineNodes
from lensforge.geometry.plan import make_plan
from lensforge.geometry.solid import build_solid
from lensforge.geometry.step import parse_step, step_bytes
from lensforge.lens import Lens
from lensforge.measurement.comparison import Side
from lensforge.surfaces.surface import Surface


@dataclass(frozen=True)
class CorrectedStep:
    """The bytes of the file, the nodes of its faces, and the worse of both faces' errors as read back."""

    step: bytes
    nodes: SplineNodes
    error: FormError


def corrected_step(lens: Lens, side: Side, corrected: Surface) -> CorrectedStep:
    """Build ``lens`` with the ``corrected`` surface on one side, on the base of its spec, by the builder of the export.

    Raises :class:`InputError` where the body cannot be built, as the export does.
    """
    surfaces = {"inner": lens.inner, "outer": lens.outer, side: corrected}
    patches = {name: fit_to_form(surface) for name, surface in surfaces.items()}
    base = base_with_room(lens)
    solid = build_solid(make_plan(patches["inner"], patches["outer"], base))
    if base.file is not None:
        solid = join_base(solid, read_custom_base(base.file))
    step = step_bytes(solid, f"{lens.spec.name} corrected {side}")
    faces = parse_step(step).faces
    errors = [face_error(surfaces["inner"], faces[INNER]), face_error(surfaces["outer"], faces[OUTER])]
    return CorrectedStep(step, SplineNodes(**{name: patch.nodes for name, patch in patches.items()}), worst(errors))
