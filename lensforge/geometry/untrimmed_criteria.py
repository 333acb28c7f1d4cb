"""The criteria on the untrimmed faces, by which a shop cuts a mould: the limits of the faces of the part."""

from lensforge.criteria import Criterion, at_most
from lensforge.geometry.acceptance import FORM_LIMIT_NM, NORMAL_LIMIT_MRAD
from lensforge.geometry.part import UntrimmedSurfaces


def untrimmed_criteria(found: UntrimmedSurfaces | None) -> tuple[Criterion, ...]:
    """The criteria on the faces of ``lens_surfaces.step``; none where there is no such file."""
    if found is None:
        return ()
    finer = "raise the number of nodes, or lower the run-out"
    return (
        at_most("surfaces_form_error", found.form_error_nm, FORM_LIMIT_NM, "nm", finer),
        at_most("surfaces_normal_error", found.normal_error_mrad, NORMAL_LIMIT_MRAD, "mrad", finer),
    )
