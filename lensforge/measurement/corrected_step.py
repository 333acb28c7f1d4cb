"""STEP file of a lens with one corrected face, its errors measured by reading it back."""

from dataclasses import dataclass

from lensforge.cad_files.step_settings import Schema
from lensforge.geometry.base_profile import INNER, OUTER
from lensforge.geometry.custom_base import read_custom_base
from lensforge.geometry.cutter_room import base_with_room
from lensforge.geometry.form import FormError, face_error, fit_to_form, worst
from lensforge.geometry.part import SplineNodes
from lensforge.geometry.plan import make_plan
from lensforge.geometry.signed_step import signed_step, solid_on_base
from lensforge.geometry.step import parse_step
from lensforge.lens import Lens
from lensforge.measurement.comparison import Side
from lensforge.surfaces.surface import Surface


@dataclass(frozen=True)
class CorrectedStep:
    """The bytes of the file, the nodes of its faces, the worse of both faces' errors and the volume as read back.

    ``volume_change``: relative, of what was written.
    """

    step: bytes
    schema: Schema
    nodes: SplineNodes
    error: FormError
    volume_change: float


def corrected_step(lens: Lens, side: Side, corrected: Surface) -> CorrectedStep:
    """Build ``lens`` with the ``corrected`` surface on one side, on the base of its spec, by the builder of the export.

    The file is signed as the export's; where the spec has a form tolerance, it is AP242 and carries it.
    Raises :class:`InputError` where the body cannot be built, as the export does.
    """
    surfaces = {"inner": lens.inner, "outer": lens.outer, side: corrected}
    patches = {name: fit_to_form(surface) for name, surface in surfaces.items()}
    base = base_with_room(lens)
    custom = None if base.file is None else read_custom_base(base.file)
    solid = solid_on_base(make_plan(patches["inner"], patches["outer"], base), custom)
    schema: Schema = "AP214" if lens.spec.manufacture.form_tolerance_um is None else "AP242"
    step = signed_step(solid, lens.spec, f"{lens.spec.name} corrected {side}", schema).content
    read = parse_step(step)
    faces, change = read.faces, abs(read.default_volume_mm3 / solid.default_volume_mm3 - 1.0)
    errors = [face_error(surfaces["inner"], faces[INNER]), face_error(surfaces["outer"], faces[OUTER])]
    nodes = SplineNodes(**{name: patch.nodes for name, patch in patches.items()})
    return CorrectedStep(step, schema, nodes, worst(errors), change)
