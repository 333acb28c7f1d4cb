"""STEP files by the CAD kernel: its settings, and the products of a file, read in a child process.

The kernel's readers are C++: a file whose references are shuffled may end the process. A file that comes from outside
is therefore read in a child, which tests what it has read and writes the shapes in the kernel's own binary format; the
parent reads them in its place. For a usual lens or clamp this takes 3 s more, most of it to load the kernel, and it is
done once for each file.
"""

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from OCP.BinTools import BinTools
from OCP.Bnd import Bnd_Box
from OCP.BRepAlgoAPI import BRepAlgoAPI_Common
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.gp import gp_Pln
from OCP.GProp import GProp_GProps
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Interface import Interface_Static
from OCP.Message import Message, Message_Gravity
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_LabelSequence
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS, TopoDS_Shape
from OCP.TopTools import TopTools_IndexedMapOfShape
from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

from lensforge.errors import InputError
from lensforge.results.file_bounds import MOST_MM, require_small_step
from lensforge.results.files import temporary_file, temporary_folder, write_json
from lensforge.results.sandbox import ChildLimits, serve, work_in_child

Schema = Literal["AP214", "AP242"]
PartKind = Literal["SOLID", "SHELL", "FACE", "WIRE", "EDGE", "VERTEX"]

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
    for printer in Message.DefaultMessenger_s().Printers():
        printer.SetTraceLevel(Message_Gravity.Message_Fail)  # no statistics on the screen
    texts = {**_TEXT_SETTINGS, "write.step.schema": KERNEL_SCHEMA[schema], "write.step.product.name": product}
    for option, text in texts.items():
        Interface_Static.SetCVal_s(option, text)
    for option, number in _NUMBER_SETTINGS.items():
        Interface_Static.SetIVal_s(option, number)
    Interface_Static.SetRVal_s("write.precision.val", _UNCERTAINTY_MM)


def new_document() -> Any:
    """An empty XCAF document, whose parts and faces may carry names."""
    return TDocStd_Document(TCollection_ExtendedString("lensforge"))


_STEP = "part.step"
_JOB = "job.json"
_PRODUCTS = "products.json"
_MEMORY_MIB = 1800  # a lens takes 0.35 GiB
# A lens of 3 MiB takes 4 s on a free core.
_SECONDS = 30.0
_SECONDS_PER_MIB = 15.0
_MOST_FACES = 10_000  # a clamp has some hundred; each costs time in every later operation
_MOST_PRODUCTS = 1000


@dataclass(frozen=True)
class Product:
    """A product of the file: its shape (TopoDS_Shape), and the faces of it (TopoDS_Face) that have names."""

    name: str
    shape: Any
    faces: dict[str, Any]


def products_in(path: Path, origin: str, remedy: str) -> list[Product]:
    """All products of the STEP file at ``path``, in mm whatever its unit, read in this process."""
    return [Product(name, shape, faces) for name, shape, faces in _shapes_in_step(path, origin, remedy)]


def parse_apart(content: bytes, origin: str, remedy: str, *, to_be_joined: bool = False) -> list[Product]:
    """All products in the bytes of a STEP file, in mm, read and tested in a child process.

    ``to_be_joined``: the child also tries what a union with a lens needs. Raises :class:`InputError` for other bytes,
    and for shapes that are not valid, too wide, or of too many faces.
    """
    products = []
    for name, binary, faces in _tested(content, origin, remedy, to_be_joined):
        shape = TopoDS_Shape()
        with temporary_file(binary, "part.bin") as path:
            BinTools.Read_s(shape, str(path))
        all_faces = parts_of(shape, "FACE")
        products.append(Product(name, shape, {face_name: all_faces[index] for face_name, index in faces.items()}))
    return products


@lru_cache(maxsize=4)  # a base is read for the search, the union, the check and the drawing; each gets its own shape
def _tested(content: bytes, origin: str, remedy: str, to_be_joined: bool) -> list[tuple[str, bytes, dict[str, int]]]:
    """Name, shape in the kernel's binary format, and numbers of the named faces of each product."""
    require_small_step(content, origin, remedy)
    limits = ChildLimits(_MEMORY_MIB, _SECONDS + _SECONDS_PER_MIB * len(content) / 2**20)
    with temporary_folder(_STEP) as folder:
        (folder / _STEP).write_bytes(content)
        write_json(folder / _JOB, {"origin": origin, "remedy": remedy, "to_be_joined": to_be_joined})
        work_in_child(Path(__file__).resolve(), folder, limits, origin=origin, remedy=remedy)
        entries = json.loads((folder / _PRODUCTS).read_text(encoding="utf-8"))
        return [(entry["name"], (folder / f"{k}.bin").read_bytes(), entry["faces"]) for k, entry in enumerate(entries)]


def shapes_in(reader: Any, path: Path, refusal: str) -> list[tuple[str, Any, dict[str, Any]]]:
    """Name, shape (TopoDS_Shape) and named faces (TopoDS_Face) of each product that a ``reader`` of OCCT finds."""
    document = new_document()
    parts = TDF_LabelSequence()
    configure("", "AP214")
    reader.SetNameMode(True)
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone or not reader.Transfer(document):
        raise InputError(refusal)
    XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).GetFreeShapes(parts)
    labels = [parts.Value(k + 1) for k in range(parts.Length())]
    # All in one go: labels are valid only as long as the document is referenced.
    return [(_name_of(label), XCAFDoc_ShapeTool.GetShape_s(label), _named_faces(label)) for label in labels]


def _shapes_in_step(path: Path, origin: str, remedy: str) -> list[tuple[str, Any, dict[str, Any]]]:
    return shapes_in(STEPCAFControl_Reader(), path, f"{origin}: not readable as STEP; {remedy}")


def _named_faces(part: Any) -> dict[str, Any]:
    """Faces (TopoDS_Face) of a product's label that have names."""
    labels = TDF_LabelSequence()
    faces = {}
    XCAFDoc_ShapeTool.GetSubShapes_s(part, labels)
    for k in range(labels.Length()):
        shape = XCAFDoc_ShapeTool.GetShape_s(labels.Value(k + 1))
        name = _name_of(labels.Value(k + 1))
        if name and not shape.IsNull() and shape.ShapeType() == TopAbs_ShapeEnum.TopAbs_FACE:
            faces[name] = TopoDS.Face_s(shape)
    return faces


def _name_of(label: Any) -> str:
    """Name of a label, "" if it has none."""
    name = TDataStd_Name()
    return str(name.Get().ToExtString()) if label.FindAttribute(TDataStd_Name.GetID_s(), name) else ""


def parts_of(shape: Any, kind: PartKind) -> list[Any]:
    """The distinct parts of a kind (TopoDS_Face for "FACE") in ``shape``, in their order."""
    distinct = TopTools_IndexedMapOfShape()
    of_kind = getattr(TopoDS, f"{kind.capitalize()}_s")
    TopExp.MapShapes_s(shape, getattr(TopAbs_ShapeEnum, f"TopAbs_{kind}"), distinct)
    return [of_kind(distinct.FindKey(k + 1)) for k in range(distinct.Extent())]


def _write_products(folder: Path) -> None:
    """Work of the child process: the tested products of the STEP file in ``folder``."""
    job = json.loads((folder / _JOB).read_text(encoding="utf-8"))
    origin = job["origin"]
    remedy = job["remedy"]
    shapes = _shapes_in_step(folder / _STEP, origin, remedy)
    if len(shapes) > _MOST_PRODUCTS:
        raise InputError(f"{origin}: {len(shapes)} products, at most {_MOST_PRODUCTS} are read; {remedy}")
    records = []
    for number, (name, shape, named) in enumerate(shapes):
        faces = parts_of(shape, "FACE")
        BinTools.Write_s(shape, str(folder / f"{number}.bin"))  # before the tests, which may add triangles to it
        _require_usable(shape, len(faces), origin, remedy, job["to_be_joined"])
        places = {
            face_name: next((k for k, face in enumerate(faces) if face.IsSame(named_face)), -1)
            for face_name, named_face in named.items()
        }
        records.append({"name": name, "faces": {face_name: place for face_name, place in places.items() if place >= 0}})
    write_json(folder / _PRODUCTS, records)


def _require_usable(shape: Any, faces: int, origin: str, remedy: str, to_be_joined: bool) -> None:
    """Raise :class:`InputError` for a shape on which later operations would fail, crash or take too long."""
    if faces > _MOST_FACES:
        raise InputError(f"{origin}: {faces} faces, at most {_MOST_FACES} are read; {remedy}")
    box = Bnd_Box()
    BRepBndLib.Add_s(shape, box, False)
    if box.IsVoid() or box.IsOpen() or not max(map(abs, box.Get())) <= MOST_MM:
        raise InputError(f"{origin}: its shape has no extent, or reaches beyond {MOST_MM:g} mm; {remedy}")
    if not BRepCheck_Analyzer(shape).IsValid():
        raise InputError(f"{origin}: its shape is not valid (open, or self-intersecting); {remedy}")
    BRepGProp.VolumeProperties_s(shape, GProp_GProps())
    if to_be_joined:
        _try_union(shape)


def _try_union(shape: Any) -> None:
    """Mesh ``shape``, and cut it at z = 0, as its union with a lens does: a faulty shape hangs or crashes here."""
    plane = BRepBuilderAPI_MakeFace(gp_Pln(), -MOST_MM, MOST_MM, -MOST_MM, MOST_MM).Face()
    BRepAlgoAPI_Common(plane, shape)
    BRepMesh_IncrementalMesh(shape, 1e-2, False, 0.1)


if __name__ == "__main__":
    serve(_write_products)
