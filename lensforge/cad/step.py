"""STEP files in mm, written to bytes and parsed from them: named faces, tolerances on them, and the header.

A file holds one part with named faces, or loose, named surfaces. The same shapes, tolerances and header give the same
bytes, so that a hash identifies them: the date is given, never the clock's.

AP242 carries tolerances on its faces (PMI): a surface profile on the optical faces, and datum A. Measured with the
kernel of cadquery 2.8 (OCCT 7.9): type, value, face and datum come back from the file as written, but the kernel writes
the number that it is given with the unit metre, whatever the unit of the part is. It is therefore given metres, and
every file is read back before it is handed out.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.STEPCAFControl import STEPCAFControl_Reader, STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_StepModelType
from OCP.TCollection import TCollection_ExtendedString, TCollection_HAsciiString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_LabelSequence
from OCP.XCAFDimTolObjects import (
    XCAFDimTolObjects_DatumObject,
    XCAFDimTolObjects_GeomToleranceObject,
    XCAFDimTolObjects_GeomToleranceType,
)
from OCP.XCAFDoc import XCAFDoc_Datum, XCAFDoc_DimTolTool, XCAFDoc_DocumentTool, XCAFDoc_GeomTolerance

from lensforge.cad.boundary import optical_name
from lensforge.cad.part_limits import FormTolerance, Signature
from lensforge.cad.plan import RIM_FLANGE_BOTTOM
from lensforge.cad.solid import Shapes, Solid
from lensforge.errors import InputError
from lensforge.results.file_bounds import made_here, remembered
from lensforge.results.files import file_bytes, temporary_file
from lensforge.spec import Spec
from lensforge.surfaces.step_file import (
    KERNEL_SCHEMA,
    Product,
    Schema,
    configure,
    new_document,
    parse_apart,
    parts_of,
    products_in,
)
from lensforge.version import __version__


def sign(model: Any, product: str, header: Signature) -> None:
    """Fill in the header of a STEP ``model``: product, time stamp, author, organisation, program and version."""

    def text(content: str) -> Any:
        return TCollection_HAsciiString(step_text(content))

    made = APIHeaderSection_MakeHeader(model)
    made.SetName(text(product))
    made.SetTimeStamp(text("" if header.date is None else f"{header.date}T00:00:00"))
    made.SetOriginatingSystem(text(f"lensforge {__version__}"))
    made.SetAuthorValue(1, text(header.author))
    made.SetOrganizationValue(1, text(header.organisation))
    made.SetDescriptionValue(1, text(product))


def step_text(content: str) -> str:
    """``content`` encoded for ISO 10303-21: ASCII, all other characters by code; the kernel doubles quotes."""

    def coded(character: str) -> str:
        code = ord(character)
        if character.isascii() and character != "\\":
            return character
        return f"\\X2\\{code:04X}\\X0\\" if code < 0x10000 else f"\\X4\\{code:08X}\\X0\\"

    return "".join(map(coded, content))


_DATUM = "A"
_IN_PLANE_MM = 1e-9
_MM_PER_M = 1e3
_SAME = 1e-9  # relative; the file has 15 digits
_REMEDY = "export with AP214, which carries no tolerance, or install cadquery 2.8"


def form_tolerances(faces: Shapes, width_um: float) -> tuple[FormTolerance, ...]:
    """Surface profiles of the optical faces among ``faces``, each against datum A, if the body has one.

    Datum A is the underside of a flange at the rim, or else the faces in z = 0.
    """
    seat = tuple(name for name in faces if name == RIM_FLANGE_BOTTOM)
    datum = seat or tuple(name for name, face in faces.items() if _lies_in_datum(face))
    optical = [name for name in reversed(faces) if name.startswith(optical_name(""))]  # from the source on
    return tuple(FormTolerance(face=name, width_um=width_um, datum_faces=datum) for name in optical)


def attach(document: Any, labels: Shapes, tolerances: tuple[FormTolerance, ...]) -> None:
    """Add ``tolerances`` to an XCAF document whose faces have ``labels`` by name."""
    tool = XCAFDoc_DocumentTool.DimTolTool_s(document.Main())
    for tolerance in tolerances:
        added = _profile(tool, labels[tolerance.face], tolerance.width_um)
        if not tolerance.datum_faces:
            continue
        plane = tool.AddDatum()
        places = TDF_LabelSequence()
        for name in tolerance.datum_faces:
            places.Append(labels[name])
        tool.SetDatum(places, plane)
        datum = XCAFDimTolObjects_DatumObject()
        datum.SetName(TCollection_HAsciiString(_DATUM))
        datum.SetPosition(1)
        XCAFDoc_Datum.Set_s(plane).SetObject(datum)
        tool.SetDatumToGeomTol(plane, added)


def _profile(tool: Any, face: Any, width_um: float) -> Any:
    """A surface profile on ``face``; the label of the tolerance."""
    added = tool.AddGeomTolerance()
    profile = XCAFDimTolObjects_GeomToleranceObject()
    tool.SetGeomTolerance(face, added)
    profile.SetType(XCAFDimTolObjects_GeomToleranceType.XCAFDimTolObjects_GeomToleranceType_ProfileOfSurface)
    profile.SetValue(1e-3 * width_um / _MM_PER_M)
    XCAFDoc_GeomTolerance.Set_s(added).SetObject(profile)
    return added


def require_written(content: bytes, tolerances: tuple[FormTolerance, ...]) -> None:
    """Raise :class:`InputError` unless a STEP file, read back from its bytes, carries exactly these tolerances."""
    written = read_tolerances(content)
    if tolerances and len(written) != len(tolerances):
        raise InputError(
            f"manufacture.form_tolerance_um = {tolerances[0].width_um:g}: this version of the CAD kernel writes "
            f"{len(written)} tolerances for {len(tolerances)}; {_REMEDY}"
        )
    read_back = {tolerance.face: tolerance for tolerance in written}
    for wanted in tolerances:
        read = read_back.pop(wanted.face, None)
        same = read is not None and abs(read.width_um / wanted.width_um - 1.0) < _SAME
        if read is None or not same or set(read.datum_faces) != set(wanted.datum_faces):
            stated = "none" if read is None else f"{read.width_um:g} um"
            raise InputError(
                f"manufacture.form_tolerance_um = {wanted.width_um:g}: this version of the CAD kernel writes {stated} "
                f"on {wanted.face}; {_REMEDY}"
            )


def read_tolerances(content: bytes) -> list[FormTolerance]:
    """The surface profiles in the bytes of a STEP file that this process has written."""
    document = new_document()
    reader = STEPCAFControl_Reader()
    labels = TDF_LabelSequence()
    configure("", "AP242")
    reader.SetNameMode(True)
    reader.SetGDTMode(True)
    with temporary_file(content, "lens.step") as path:
        reader.ReadFile(str(path))
        reader.Transfer(document)
    XCAFDoc_DocumentTool.DimTolTool_s(document.Main()).GetGeomToleranceLabels(labels)
    # Labels are valid only as long as the document is referenced.
    return [_read_tolerance(labels.Value(k + 1)) for k in range(labels.Length())]


def _read_tolerance(tolerance: Any) -> FormTolerance:
    datums = TDF_LabelSequence()
    XCAFDoc_DimTolTool.GetDatumOfTolerLabels_s(tolerance, datums)
    return FormTolerance(
        face=_faces_of(tolerance)[0],
        width_um=1e3 * XCAFDoc_GeomTolerance.Set_s(tolerance).GetObject().GetValue(),
        datum_faces=tuple(name for k in range(datums.Length()) for name in _faces_of(datums.Value(k + 1))),
    )


def _faces_of(label: Any) -> list[str]:
    """Names of the faces to which a tolerance or a datum belongs."""
    first = TDF_LabelSequence()
    second = TDF_LabelSequence()
    names = []
    XCAFDoc_DimTolTool.GetRefShapeLabel_s(label, first, second)
    for k in range(first.Length()):
        name = TDataStd_Name()
        first.Value(k + 1).FindAttribute(TDataStd_Name.GetID_s(), name)
        names.append(str(name.Get().ToExtString()))
    return names


def _lies_in_datum(face: Any) -> bool:
    """True for a plane face in z = 0."""
    plane = BRepAdaptor_Surface(face).GetType() == GeomAbs_SurfaceType.GeomAbs_Plane
    return plane and all(abs(BRep_Tool.Pnt_s(corner).Z()) < _IN_PLANE_MM for corner in parts_of(face, "VERTEX"))


_UNSIGNED = Signature(author="", organisation="", date=None)
_EXPORT_AGAIN = "run `lensforge export` again"


def require_schema(schema: str) -> None:
    """Raise :class:`InputError` for a schema other than AP214 and AP242."""
    if schema not in KERNEL_SCHEMA:
        raise InputError(f"schema = {schema!r}: one of {', '.join(KERNEL_SCHEMA)}")


def step_bytes(
    solid: Solid,
    product: str,
    schema: Schema = "AP214",
    *,
    header: Signature = _UNSIGNED,
    tolerances: tuple[FormTolerance, ...] = (),
) -> bytes:
    """A STEP file of ``solid`` as the part ``product``, its faces under their names, with ``tolerances`` (AP242 only).

    Raises :class:`InputError` where the CAD kernel does not write the tolerances as they are.
    """
    content = parts_bytes({product: solid.shape}, solid.faces, product, schema, header, tolerances)
    if tolerances:
        require_written(content, tolerances)
    return content


@dataclass(frozen=True)
class SignedStep:
    """The bytes of the file, its author and date, and the tolerances on its faces."""

    content: bytes
    signature: Signature
    tolerances: tuple[FormTolerance, ...]


def signed_step(solid: Solid, spec: Spec, product: str, schema: Schema, date: str | None = None) -> SignedStep:
    """STEP file of ``solid`` as ``product``; AP242 carries ``manufacture.form_tolerance_um``.

    ``date``: by default ``manufacture.date``. Raises :class:`InputError` for tolerances that the kernel does not write.
    """
    shop = spec.manufacture
    signature = Signature(author=shop.author, organisation=shop.organisation, date=date or shop.date)
    width_um = shop.form_tolerance_um if schema == "AP242" else None
    tolerances = () if width_um is None else form_tolerances(solid.faces, width_um)
    content = step_bytes(solid, product, schema, header=signature, tolerances=tolerances)
    return SignedStep(content, signature, tolerances)


def parts_bytes(
    parts: Shapes, faces: Shapes, product: str, schema: Schema, header: Signature, tolerances: tuple[FormTolerance, ...]
) -> bytes:
    """A STEP file of ``parts``, each a product under its name; ``faces`` of a single one, with names and tolerances."""
    writer = STEPCAFControl_Writer()
    configure(product, schema)
    writer.SetNameMode(True)
    writer.SetDimTolMode(bool(tolerances))
    writer.Transfer(_document(parts, faces, tolerances), STEPControl_StepModelType.STEPControl_AsIs)
    sign(writer.ChangeWriter().Model(), product, header)

    def write(path: Path) -> None:
        if writer.Write(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise InputError(f"{product}: the STEP file could not be written to {path.parent}; is the disk full?")

    return remembered(file_bytes("lens.step", write))


def parse_step(content: bytes, origin: str = "lens.step") -> Solid:
    """The one solid of a STEP file's bytes and its named faces.

    Raises :class:`InputError` for anything else; ``origin`` names the file in the message.
    """
    parts = _parse(content, origin)
    solids = [solid for part in parts for solid in parts_of(part.shape, "SOLID")]
    if len(solids) != 1:
        raise InputError(f"{origin}: holds {len(solids)} solids, a lens is one; {_EXPORT_AGAIN}")
    return Solid(solids[0], parts[0].faces)


def parse_surfaces(content: bytes, origin: str = "lens_surfaces.step") -> Shapes:
    """The loose faces (TopoDS_Face) of a STEP file's bytes by name. Raises :class:`InputError`."""
    faces = {part.name: parts_of(part.shape, "FACE") for part in _parse(content, origin)}
    return {name: face[0] for name, face in faces.items() if len(face) == 1}


def _parse(content: bytes, origin: str) -> list[Product]:
    if not made_here(content):
        return parse_apart(content, origin, _EXPORT_AGAIN)
    with temporary_file(content, "lens.step") as path:
        return products_in(path, origin, _EXPORT_AGAIN)


def _document(parts: Shapes, faces: Shapes, tolerances: tuple[FormTolerance, ...]) -> Any:
    """An XCAF document, so that parts, and the faces of a single one, carry names and tolerances."""
    document = new_document()
    labels = {}
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    for product, shape in parts.items():
        part = shapes.AddShape(shape, False)
        TDataStd_Name.Set_s(part, TCollection_ExtendedString(product))
    for name, face in faces.items():
        labels[name] = shapes.AddSubShape(part, face)
        TDataStd_Name.Set_s(labels[name], TCollection_ExtendedString(name))
    attach(document, labels, tolerances)
    return document
