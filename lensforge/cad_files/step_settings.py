"""Settings of the CAD kernel for STEP files, and its empty document."""

from typing import Any, Literal

Schema = Literal["AP214", "AP242"]

KERNEL_SCHEMA: dict[Schema, str] = {"AP214": "AP214IS", "AP242": "AP242DIS"}
_TEXT_SETTINGS = {"write.step.unit": "MM", "xstep.cascade.unit": "MM"}
_NUMBER_SETTINGS = {
    "write.surfacecurve.mode": 1,  # keep the parameter curves: readers trim by them (FreeCAD #32435)
    "write.stepcaf.subshapes.name": 1,
    "read.stepcaf.subshapes.name": 1,
    "write.precision.mode": 2,  # state the uncertainty below, whatever the largest vertex tolerance is
}
_UNCERTAINTY_MM = 1e-5


def configure(product: str, schema: Schema) -> None:
    """Set the CAD kernel's options, which are global and exist only after a reader or writer has been made."""
    from OCP.Interface import Interface_Static

    texts = {**_TEXT_SETTINGS, "write.step.schema": KERNEL_SCHEMA[schema], "write.step.product.name": product}
    for option, text in texts.items():
        Interface_Static.SetCVal_s(option, text)
    for option, number in _NUMBER_SETTINGS.items():
        Interface_Static.SetIVal_s(option, number)
    Interface_Static.SetRVal_s("write.precision.val", _UNCERTAINTY_MM)


def new_document() -> Any:
    """An empty XCAF document, whose parts and faces may carry names."""
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document

    return TDocStd_Document(TCollection_ExtendedString("lensforge"))
