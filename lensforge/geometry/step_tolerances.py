"""Tolerances that an AP242 file carries on its faces (PMI): a surface profile on the optical faces, datum A in z = 0.

Measured with the kernel of cadquery 2.8 (OCCT 7.9): type, value, face and datum come back from the file as written, but
the kernel writes the number that it is given with the unit metre, whatever the unit of the part is. It is therefore
given metres, and every file is read back before it is handed out.
"""

from typing import Any

from lensforge.cad_files.step_settings import configure, new_document
from lensforge.errors import InputError
from lensforge.files import temporary_file
from lensforge.geometry.base_profile import INNER, OUTER
from lensforge.geometry.form_tolerance import FormTolerance

_DATUM = "A"
_IN_PLANE_MM = 1e-9
_MM_PER_M = 1e3
_SAME = 1e-9  # relative; the file has 15 digits
_REMEDY = "export with AP214, which carries no tolerance, or install cadquery 2.8"


def form_tolerances(faces: dict[str, Any], width_um: float) -> tuple[FormTolerance, ...]:
    """Surface profiles of the optical faces among ``faces``, each against datum A where a face lies in z = 0."""
    datum = tuple(name for name, face in faces.items() if _lies_in_datum(face))
    return tuple(FormTolerance(face=name, width_um=width_um, datum_faces=datum) for name in (INNER, OUTER))


def attach(document: Any, labels: dict[str, Any], tolerances: tuple[FormTolerance, ...]) -> None:
    """Add ``tolerances`` to an XCAF document whose faces have ``labels`` by name."""
    from OCP.TCollection import TCollection_HAsciiString
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDimTolObjects import XCAFDimTolObjects_DatumObject
    from OCP.XCAFDoc import XCAFDoc_Datum, XCAFDoc_DocumentTool

    tool = XCAFDoc_DocumentTool.DimTolTool_s(document.Main())
    for tolerance in tolerances:
        added = _profile(tool, labels[tolerance.face], tolerance.width_um)
        if not tolerance.datum_faces:
            continue
        plane, places = tool.AddDatum(), TDF_LabelSequence()
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
    from OCP.XCAFDimTolObjects import XCAFDimTolObjects_GeomToleranceObject, XCAFDimTolObjects_GeomToleranceType
    from OCP.XCAFDoc import XCAFDoc_GeomTolerance

    added, profile = tool.AddGeomTolerance(), XCAFDimTolObjects_GeomToleranceObject()
    tool.SetGeomTolerance(face, added)
    profile.SetType(XCAFDimTolObjects_GeomToleranceType.XCAFDimTolObjects_GeomToleranceType_ProfileOfSurface)
    profile.SetValue(1e-3 * width_um / _MM_PER_M)
    XCAFDoc_GeomTolerance.Set_s(added).SetObject(profile)
    return added


def require_written(content: bytes, tolerances: tuple[FormTolerance, ...]) -> None:
    """Raise :class:`InputError` where a STEP file does not carry just these tolerances, read back from its bytes."""
    written = read_tolerances(content)
    if tolerances and len(written) != len(tolerances):
        raise InputError(
            f"manufacture.form_tolerance_um = {tolerances[0].width_um:g}: this version of the CAD kernel writes "
            f"{len(written)} tolerances for {len(tolerances)}; {_REMEDY}"
        )
    found = {tolerance.face: tolerance for tolerance in written}
    for wanted in tolerances:
        read = found.pop(wanted.face, None)
        same = read is not None and abs(read.width_um / wanted.width_um - 1.0) < _SAME
        if read is None or not same or set(read.datum_faces) != set(wanted.datum_faces):
            stated = "none" if read is None else f"{read.width_um:g} um"
            raise InputError(
                f"manufacture.form_tolerance_um = {wanted.width_um:g}: this version of the CAD kernel writes {stated} "
                f"on {wanted.face}; {_REMEDY}"
            )


def read_tolerances(content: bytes) -> list[FormTolerance]:
    """The surface profiles in the bytes of a STEP file that this process has written."""
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document, reader, labels = new_document(), STEPCAFControl_Reader(), TDF_LabelSequence()
    configure("", "AP242")
    reader.SetNameMode(True)
    reader.SetGDTMode(True)
    with temporary_file(content, "lens.step") as path:
        reader.ReadFile(str(path))
        reader.Transfer(document)
    XCAFDoc_DocumentTool.DimTolTool_s(document.Main()).GetGeomToleranceLabels(labels)
    # Labels are valid only as long as the document is referenced.
    return [_read(labels.Value(k + 1)) for k in range(labels.Length())]


def _read(tolerance: Any) -> FormTolerance:
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_DimTolTool, XCAFDoc_GeomTolerance

    datums = TDF_LabelSequence()
    XCAFDoc_DimTolTool.GetDatumOfTolerLabels_s(tolerance, datums)
    return FormTolerance(
        face=_faces_of(tolerance)[0],
        width_um=1e3 * XCAFDoc_GeomTolerance.Set_s(tolerance).GetObject().GetValue(),
        datum_faces=tuple(name for k in range(datums.Length()) for name in _faces_of(datums.Value(k + 1))),
    )


def _faces_of(label: Any) -> list[str]:
    """Names of the faces to which a tolerance or a datum belongs."""
    from OCP.TDataStd import TDataStd_Name
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_DimTolTool

    first, second, names = TDF_LabelSequence(), TDF_LabelSequence(), []
    XCAFDoc_DimTolTool.GetRefShapeLabel_s(label, first, second)
    for k in range(first.Length()):
        name = TDataStd_Name()
        first.Value(k + 1).FindAttribute(TDataStd_Name.GetID_s(), name)
        names.append(str(name.Get().ToExtString()))
    return names


def _lies_in_datum(face: Any) -> bool:
    """True for a plane face in z = 0."""
    return face.geomType() == "PLANE" and all(abs(corner.Z) < _IN_PLANE_MM for corner in face.Vertices())
