"""STEP files in mm, written to bytes and parsed from them: one part with named faces, or loose, named surfaces.

The same shapes give the same bytes: the header carries no time, so that a hash identifies the geometry.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from lensforge.errors import InputError
from lensforge.files import file_bytes, temporary_file
from lensforge.geometry.solid import Solid
from lensforge.version import __version__

if TYPE_CHECKING:
    import cadquery

Schema = Literal["AP214", "AP242"]

_KERNEL_SCHEMA: dict[Schema, str] = {"AP214": "AP214IS", "AP242": "AP242DIS"}
_TEXT_SETTINGS = {"write.step.unit": "MM", "xstep.cascade.unit": "MM"}
_NUMBER_SETTINGS = {
    "write.surfacecurve.mode": 1,  # keep the parameter curves: readers trim by them (FreeCAD #32435)
    "write.stepcaf.subshapes.name": 1,
    "read.stepcaf.subshapes.name": 1,
    "write.precision.mode": 2,  # state the uncertainty below, whatever the largest vertex tolerance is
}
_UNCERTAINTY_MM = 1e-5
_NO_TIME = "1970-01-01T00:00:00"

_EXPORT_AGAIN = "run `lensforge export` again"


@dataclass(frozen=True)
class Product:
    """A product of the file: its ``cadquery.Shape``, and the faces of it that have names."""

    name: str
    shape: Any
    faces: dict[str, Any]


def require_schema(schema: str) -> None:
    """Raise :class:`InputError` for a schema other than AP214 and AP242."""
    if schema not in _KERNEL_SCHEMA:
        raise InputError(f"schema = {schema!r}: one of {', '.join(_KERNEL_SCHEMA)}")


def step_bytes(solid: Solid, product: str, schema: Schema = "AP214") -> bytes:
    """A STEP file of ``solid`` as the part ``product``, its faces under their names."""
    return _bytes({product: solid.shape}, solid.faces, product, schema)


def surfaces_bytes(faces: dict[str, Any], product: str, schema: Schema = "AP214") -> bytes:
    """A STEP file of loose faces (``cadquery.Face``), each a product under its name."""
    return _bytes(faces, {}, product, schema)


def _bytes(parts: dict[str, Any], faces: dict[str, Any], product: str, schema: Schema) -> bytes:
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.STEPControl import STEPControl_StepModelType

    writer = STEPCAFControl_Writer()
    _configure(product, schema)
    writer.SetNameMode(True)
    writer.Transfer(_document(parts, faces), STEPControl_StepModelType.STEPControl_AsIs)
    _sign(writer.ChangeWriter().Model(), product)

    def write(path: Path) -> None:
        if writer.Write(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise InputError(f"{product}: the STEP file could not be written to {path.parent}; is the disk full?")

    return file_bytes("lens.step", write)


def parse_step(content: bytes, origin: str = "lens.step") -> Solid:
    """The one solid of a STEP file's bytes and its named faces.

    Raises :class:`InputError` for anything else; ``origin`` names the file in the message.
    """
    parts = _parse(content, origin)
    solids = [solid for part in parts for solid in part.shape.Solids()]
    if len(solids) != 1:
        raise InputError(f"{origin}: holds {len(solids)} solids, a lens is one; {_EXPORT_AGAIN}")
    return Solid(solids[0], parts[0].faces)


def solid_of_step(content: bytes) -> "cadquery.Solid":
    """The one solid (mm) of a STEP file's bytes. Raises :class:`InputError`."""
    solid: cadquery.Solid = parse_step(content).shape
    return solid


def parse_surfaces(content: bytes, origin: str = "lens_surfaces.step") -> dict[str, Any]:
    """The loose faces (``cadquery.Face``) of a STEP file's bytes by name. Raises :class:`InputError`."""
    return {part.name: part.shape.Faces()[0] for part in _parse(content, origin) if len(part.shape.Faces()) == 1}


def _parse(content: bytes, origin: str) -> list[Product]:
    with temporary_file(content, "lens.step") as path:
        return _products(path, origin, _EXPORT_AGAIN)


def read_products(path: Path, missing: str, damaged: str) -> list[Product]:
    """All products of a STEP file, in mm whatever its unit; the remedies go into the :class:`InputError`."""
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; {missing}")
    return _products(path, str(path), damaged)


def _products(path: Path, origin: str, remedy: str) -> list[Product]:
    import cadquery as cq
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

    reader, document, parts = STEPCAFControl_Reader(), _new_document(), TDF_LabelSequence()
    _configure("", "AP214")
    reader.SetNameMode(True)
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone or not reader.Transfer(document):
        raise InputError(f"{origin}: not readable as STEP; {remedy}")
    XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).GetFreeShapes(parts)
    labels = [parts.Value(k + 1) for k in range(parts.Length())]
    # All in one go: labels are valid only as long as the document is referenced.
    return [
        Product(_name(label), cq.Shape.cast(XCAFDoc_ShapeTool.GetShape_s(label)), _named_faces(label))
        for label in labels
    ]


def _named_faces(part: Any) -> dict[str, Any]:
    import cadquery as cq
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_ShapeTool

    labels, faces = TDF_LabelSequence(), {}
    XCAFDoc_ShapeTool.GetSubShapes_s(part, labels)
    for k in range(labels.Length()):
        shape, name = cq.Shape.cast(XCAFDoc_ShapeTool.GetShape_s(labels.Value(k + 1))), _name(labels.Value(k + 1))
        if isinstance(shape, cq.Face) and name:
            faces[name] = shape
    return faces


def _name(label: Any) -> str:
    from OCP.TDataStd import TDataStd_Name

    name = TDataStd_Name()
    return str(name.Get().ToExtString()) if label.FindAttribute(TDataStd_Name.GetID_s(), name) else ""


def _configure(product: str, schema: Schema) -> None:
    """Set the CAD kernel's options, which are global and exist only after a reader or writer has been made."""
    from OCP.Interface import Interface_Static

    texts = {**_TEXT_SETTINGS, "write.step.schema": _KERNEL_SCHEMA[schema], "write.step.product.name": product}
    for option, text in texts.items():
        Interface_Static.SetCVal_s(option, text)
    for option, number in _NUMBER_SETTINGS.items():
        Interface_Static.SetIVal_s(option, number)
    Interface_Static.SetRVal_s("write.precision.val", _UNCERTAINTY_MM)


def _new_document() -> Any:
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document

    return TDocStd_Document(TCollection_ExtendedString("lensforge"))


def _document(parts: dict[str, Any], faces: dict[str, Any]) -> Any:
    """An XCAF document, so that parts, and the faces of a single one, carry names."""
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document = _new_document()
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    for product, shape in parts.items():
        part = shapes.AddShape(shape.wrapped, False)
        TDataStd_Name.Set_s(part, TCollection_ExtendedString(product))
    for name, face in faces.items():
        TDataStd_Name.Set_s(shapes.AddSubShape(part, face.wrapped), TCollection_ExtendedString(name))
    return document


def _sign(model: Any, product: str) -> None:
    """Fill in the header: the program and its version, no time."""
    from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
    from OCP.TCollection import TCollection_HAsciiString

    header = APIHeaderSection_MakeHeader(model)
    header.SetName(TCollection_HAsciiString(product))
    header.SetTimeStamp(TCollection_HAsciiString(_NO_TIME))
    header.SetOriginatingSystem(TCollection_HAsciiString(f"lensforge {__version__}"))
    header.SetAuthorValue(1, TCollection_HAsciiString(""))
    header.SetOrganizationValue(1, TCollection_HAsciiString(""))
