"""The first contradiction of any record of a result folder."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from pydantic import ValidationError

from lensforge.agreement.correction import correction_contradictions
from lensforge.agreement.cutting import check_contradictions
from lensforge.agreement.light import light_contradictions
from lensforge.agreement.part import part_contradictions
from lensforge.agreement.parts import yield_contradictions
from lensforge.agreement.proof import proof_contradictions, stray_contradictions
from lensforge.agreement.search import design_contradictions
from lensforge.agreement.studies import (
    photo_contradictions,
    photometry_contradictions,
    sensitivity_contradictions,
    surface_contradictions,
)
from lensforge.evaluation.light import Light
from lensforge.far_field.photometry import Photometry
from lensforge.geometry.part import Part
from lensforge.lens import Lens
from lensforge.manufacturing.result import Check
from lensforge.measurement.comparison import PhotoComparison, SurfaceComparison
from lensforge.measurement.correction_result import Correction
from lensforge.optimisation.design import Design
from lensforge.records import StageResult
from lensforge.tolerancing.sensitivity_table import Sensitivity
from lensforge.tolerancing.yield_result import Yield
from lensforge.verification.proof import Proof
from lensforge.verification.stray_result import StrayLight

if TYPE_CHECKING:
    from lensforge.verification.screen import Screen


def contradiction(result: StageResult, lens: Lens, found: Mapping[str, StageResult]) -> str:
    """The first thing that ``result`` states against its own values, against ``lens``, or what it was made from.

    ``found``: the results by stem that it was made from. Empty where everything agrees.
    """
    try:
        with np.errstate(all="ignore"):
            return next(_contradictions(result, lens, found), "")
    except (ValidationError, ArithmeticError):  # the ends of their ranges, where what follows from them is beyond
        return "what follows from its numbers is beyond any range"


def _contradictions(result: StageResult, lens: Lens, found: Mapping[str, StageResult]) -> Iterator[str]:
    match result:
        case Design():
            yield from design_contradictions(result, lens)
        case Light():
            yield from light_contradictions(result, lens)
        case Part():
            yield from part_contradictions(result)
        case Check():
            yield from check_contradictions(result, lens)
        case Proof():
            light = found.get(Light.stage)
            own = light if isinstance(light, Light) else None
            part = found.get(Part.stage)
            of = part if isinstance(part, Part) else None
            yield from proof_contradictions(result, _screens(lens), own, of)
        case StrayLight():
            yield from stray_contradictions(result)
        case Photometry():
            yield from photometry_contradictions(result)
        case Sensitivity():
            yield from sensitivity_contradictions(result)
        case Yield():
            yield from yield_contradictions(result, lens)
        case PhotoComparison():
            yield from photo_contradictions(result)
        case SurfaceComparison():
            yield from surface_contradictions(result)
        case Correction():
            yield from correction_contradictions(result, lens)


def _screens(lens: Lens) -> "list[Screen]":
    """Receivers, from whose places the limits of a verification follow."""
    from lensforge.screens import screens_of

    return screens_of(lens.spec)
