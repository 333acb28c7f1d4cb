"""All faces of a STEP or IGES file in mm, with their names."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lensforge.cad_files.step_reading import faces_of, name_of, named_faces
from lensforge.cad_files.step_settings import configure, new_document
from lensforge.errors import InputError

_REMEDY = "export it again from CAD"
_MOST_FACES = 10_000
_UNITS = {"millimetre": "mm", "mm": "mm", "inch": "inches", "in": "inches", "inches": "inches", "metre": "metres"}


@dataclass(frozen=True)
class NamedFace:
    """A face (TopoDS_Face), its name, "" where it has none, and its number in the file, from 1."""

    face: Any
    name: str
    number: int

    @property
    def words(self) -> str:
        """Its name, or its number."""
        return f"face {self.name}" if self.name else f"face {self.number}"


def faces_in_step(path: Path, origin: str) -> tuple[list[NamedFace], str]:
    """Faces of the STEP file at ``path``, and the unit in which it is written."""
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TColStd import TColStd_SequenceOfAsciiString

    reader = STEPCAFControl_Reader()
    configure("", "AP214")
    reader.SetNameMode(True)
    faces = _transferred(reader, path, f"{origin}: not readable as STEP; {_REMEDY}")
    lengths, angles, solid_angles = (TColStd_SequenceOfAsciiString() for _ in range(3))
    reader.ChangeReader().FileUnits(lengths, angles, solid_angles)
    unit = lengths.Value(1).ToCString() if lengths.Length() else "mm"
    return _numbered(faces, origin), _in_words(unit)


def faces_in_iges(path: Path, origin: str) -> tuple[list[NamedFace], str]:
    """Faces of the IGES file at ``path``, and the unit in which it is written."""
    from OCP.IGESCAFControl import IGESCAFControl_Reader

    reader = IGESCAFControl_Reader()
    configure("", "AP214")
    reader.SetNameMode(True)
    faces = _transferred(reader, path, f"{origin}: not readable as IGES; {_REMEDY}")
    unit = reader.IGESModel().GlobalSection().UnitName()
    return _numbered(faces, origin), _in_words("mm" if unit is None else unit.ToCString())


def _transferred(reader: Any, path: Path, refusal: str) -> list[tuple[str, Any]]:
    """Name and face of all that ``reader`` finds."""
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

    document, parts = new_document(), TDF_LabelSequence()
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone or not reader.Transfer(document):
        raise InputError(refusal)
    XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).GetFreeShapes(parts)
    found = []
    for label in [parts.Value(k + 1) for k in range(parts.Length())]:
        shape, named = XCAFDoc_ShapeTool.GetShape_s(label), named_faces(label)
        if shape.IsNull():
            continue
        every = faces_of(shape)
        alone = name_of(label) if len(every) == 1 else ""  # a face that is a product of its own
        for face in every:
            found.append((next((name for name, one in named.items() if one.IsSame(face)), alone), face))
    return found


def _numbered(faces: list[tuple[str, Any]], origin: str) -> list[NamedFace]:
    if not faces:
        raise InputError(f"{origin}: holds no face; {_REMEDY}")
    if len(faces) > _MOST_FACES:
        raise InputError(f"{origin}: {len(faces)} faces, at most {_MOST_FACES} are read; export the one alone")
    return [NamedFace(face, name, number) for number, (name, face) in enumerate(faces, start=1)]


def _in_words(unit: str) -> str:
    return _UNITS.get(unit.strip().lower(), unit.strip().lower())
