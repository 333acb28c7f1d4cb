"""STEP files in mm, written to bytes and parsed from them: one part with named faces, or loose, named surfaces.

The same shapes, tolerances and header give the same bytes, so that a hash identifies them: no time is the clock's.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from lensforge.cad_files.step_reading import Product, parse_apart, products_in
from lensforge.cad_files.step_settings import KERNEL_SCHEMA, Schema, configure, new_document
from lensforge.errors import InputError
from lensforge.files import file_bytes, temporary_file
from lensforge.geometry.form_tolerance import FormTolerance
from lensforge.geometry.solid import Solid
from lensforge.geometry.step_header import StepHeader, sign
from lensforge.geometry.step_tolerances import attach, require_written
from lensforge.untrusted.own_content import made_here, remembered

if TYPE_CHECKING:
    import cadquery

_UNSIGNED = StepHeader()
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
    header: StepHeader = _UNSIGNED,
    tolerances: tuple[FormTolerance, ...] = (),
) -> bytes:
    """A STEP file of ``solid`` as the part ``product``, its faces under their names, with ``tolerances`` (AP242 only).

    Raises :class:`InputError` where the CAD kernel does not write the tolerances as they are.
    """
    content = _bytes({product: solid.shape}, solid.faces, product, schema, header, tolerances)
    if tolerances:
        require_written(content, tolerances)
    return content


def surfaces_bytes(
    faces: dict[str, Any], product: str, schema: Schema = "AP214", *, header: StepHeader = _UNSIGNED
) -> bytes:
    """A STEP file of loose faces (``cadquery.Face``), each a product under its name."""
    return _bytes(faces, {}, product, schema, header, ())


def _bytes(
    parts: dict[str, Any],
    faces: dict[str, Any],
    product: str,
    schema: Schema,
    header: StepHeader,
    tolerances: tuple[FormTolerance, ...],
) -> bytes:
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.STEPControl import STEPControl_StepModelType

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
    if not made_here(content):
        return parse_apart(content, origin, _EXPORT_AGAIN)
    with temporary_file(content, "lens.step") as path:
        return products_in(path, origin, _EXPORT_AGAIN)


def _document(parts: dict[str, Any], faces: dict[str, Any], tolerances: tuple[FormTolerance, ...]) -> Any:
    """An XCAF document, so that parts, and the faces of a single one, carry names and tolerances."""
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document, labels = new_document(), {}
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    for product, shape in parts.items():
        part = shapes.AddShape(shape.wrapped, False)
        TDataStd_Name.Set_s(part, TCollection_ExtendedString(product))
    for name, face in faces.items():
        labels[name] = shapes.AddSubShape(part, face.wrapped)
        TDataStd_Name.Set_s(labels[name], TCollection_ExtendedString(name))
    attach(document, labels, tolerances)
    return document
