"""STEP AP214 in mm: one part with named faces, written and read back."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from lensforge.errors import InputError
from lensforge.files import replacing
from lensforge.geometry.solid import Solid
from lensforge.version import __version__

_TEXT_SETTINGS = {"write.step.schema": "AP214IS", "write.step.unit": "MM", "xstep.cascade.unit": "MM"}
_NUMBER_SETTINGS = {
    "write.surfacecurve.mode": 1,  # keep the parameter curves: readers trim by them (FreeCAD #32435)
    "write.stepcaf.subshapes.name": 1,
    "read.stepcaf.subshapes.name": 1,
    "write.precision.mode": 2,  # state the uncertainty below, whatever the widest vertex of a crossing is
}
_UNCERTAINTY_MM = 1e-5


def write_step(solid: Solid, path: Path, product: str) -> None:
    """Write ``solid`` as the part ``product``, its faces under their names."""
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.STEPControl import STEPControl_StepModelType

    writer = STEPCAFControl_Writer()
    _configure(product)
    writer.SetNameMode(True)
    writer.Transfer(_document(solid, product), STEPControl_StepModelType.STEPControl_AsIs)
    _sign(writer.ChangeWriter().Model(), product)
    with replacing(path) as temporary:
        if writer.Write(str(temporary)) != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise InputError(f"{path}: the STEP file could not be written; is the disk full?")


def read_step(path: Path) -> Solid:
    """Read the one solid of a STEP file and its named faces. Raises :class:`InputError` for anything else."""
    import cadquery as cq
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; run `lensforge export` first")
    reader, document, parts = STEPCAFControl_Reader(), _new_document(), TDF_LabelSequence()
    _configure("")
    reader.SetNameMode(True)
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone or not reader.Transfer(document):
        raise InputError(f"{path}: not readable as STEP; run `lensforge export` again")
    XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).GetFreeShapes(parts)
    shapes = [cq.Shape.cast(XCAFDoc_ShapeTool.GetShape_s(parts.Value(k + 1))) for k in range(parts.Length())]
    solids = [solid for shape in shapes for solid in shape.Solids()]
    if len(solids) != 1:
        raise InputError(f"{path}: holds {len(solids)} solids, a lens is one; run `lensforge export` again")
    return Solid(solids[0], _named_faces(parts.Value(1)))


def _named_faces(part: Any) -> dict[str, Any]:
    import cadquery as cq
    from OCP.TDataStd import TDataStd_Name
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_ShapeTool

    labels, faces = TDF_LabelSequence(), {}
    XCAFDoc_ShapeTool.GetSubShapes_s(part, labels)
    for k in range(labels.Length()):
        shape, name = cq.Shape.cast(XCAFDoc_ShapeTool.GetShape_s(labels.Value(k + 1))), TDataStd_Name()
        if isinstance(shape, cq.Face) and labels.Value(k + 1).FindAttribute(TDataStd_Name.GetID_s(), name):
            faces[str(name.Get().ToExtString())] = shape
    return faces


def _configure(product: str) -> None:
    """Set the kernel's options: they are global, and exist only once a reader or writer has been made."""
    from OCP.Interface import Interface_Static

    for option, text in {**_TEXT_SETTINGS, "write.step.product.name": product}.items():
        Interface_Static.SetCVal_s(option, text)
    for option, number in _NUMBER_SETTINGS.items():
        Interface_Static.SetIVal_s(option, number)
    Interface_Static.SetRVal_s("write.precision.val", _UNCERTAINTY_MM)


def _new_document() -> Any:
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document

    return TDocStd_Document(TCollection_ExtendedString("lensforge"))


def _document(solid: Solid, product: str) -> Any:
    """An XCAF document of one part, so that faces carry names."""
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document = _new_document()
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    part = shapes.AddShape(solid.shape.wrapped, False)
    TDataStd_Name.Set_s(part, TCollection_ExtendedString(product))
    for name, face in solid.faces.items():
        TDataStd_Name.Set_s(shapes.AddSubShape(part, face.wrapped), TCollection_ExtendedString(name))
    return document


def _sign(model: Any, product: str) -> None:
    """Fill in the header: what wrote the file, and when."""
    from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
    from OCP.TCollection import TCollection_HAsciiString

    header = APIHeaderSection_MakeHeader(model)
    header.SetName(TCollection_HAsciiString(product))
    header.SetTimeStamp(TCollection_HAsciiString(datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")))
    header.SetOriginatingSystem(TCollection_HAsciiString(f"lensforge {__version__}"))
    header.SetAuthorValue(1, TCollection_HAsciiString(""))
    header.SetOrganizationValue(1, TCollection_HAsciiString(""))
