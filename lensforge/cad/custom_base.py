"""A custom base: one solid from the user's STEP file, in the lens's coordinates, joined to the body and to its mesh.

Its top lies in z = 0, on the plane ring between the two rims: only plane faces that touch take part in the union, and
the optical faces keep their surfaces. The union of the meshes keeps every vertex of the optical faces, and adds some to
their rims where the base's outline crosses them.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from OCP.Bnd import Bnd_Box
from OCP.BRepAlgoAPI import BRepAlgoAPI_Common, BRepAlgoAPI_Fuse
from OCP.BRepBndLib import BRepBndLib
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS
from OCP.TopTools import TopTools_IndexedMapOfShape

from lensforge.cad.boundary import optical_name
from lensforge.cad.mesh import BodyMesh, manifold_of
from lensforge.cad.plan import RIM
from lensforge.cad.solid import Solid, uniquely_named
from lensforge.errors import InputError
from lensforge.results.file_bounds import MOST_STEP_MIB
from lensforge.results.files import MIB, read_file
from lensforge.surfaces.solid_file import tessellated
from lensforge.surfaces.step_file import Product, parse_apart, parts_of

BASE = "BASE"

_PLANE_MM = 1e-5  # the uncertainty that STEP files state
_COVERED_SHARE = 1e-4  # of the opening: a bore as wide as the cavity covers none of it, up to rounding
_VOLUME_SHARE = 1e-7  # of the base: largest change of volume in the union
_MOST_SHOWN = 60  # characters of a name


@dataclass(frozen=True)
class CustomBase:
    """The solid of a file, in mm, with its named faces, and the file."""

    solid: Solid
    path: Path


def read_custom_base(path: Path) -> CustomBase:
    """The only solid of ``path``, read in a child process, as it is a file from outside.

    Raises :class:`InputError` for anything else, and if its top is not in z = 0.
    """
    missing = "base.file is relative to the folder of its spec"
    content = read_file(path, missing=missing, most_bytes=MOST_STEP_MIB * MIB)
    solids = solids_in(content, path)
    if len(solids) != 1:
        raise InputError(f"{path}: holds {len(solids)} solids, a base is one; join them, or export the one alone")
    (base,) = solids
    if not base.valid:
        raise InputError(f"{path}: its solid is not valid (open, or self-intersecting); repair it in CAD")
    top = _top_mm(base)
    if abs(top) > _PLANE_MM:
        raise InputError(f"{path}: its top is at z = {top:.6g} mm, the lens ends at 0; move it by {-top:.6g} mm in z")
    return CustomBase(base, path)


def solids_in(content: bytes, path: Path) -> list[Solid]:
    """The solids in the bytes of the user's STEP file ``path``.

    Raises :class:`InputError` for anything else, and for faces that bound no solid: they would be ignored.
    """
    parts = parse_apart(
        content, str(path), "repair it in CAD, and export it as AP203, AP214 or AP242", to_be_joined=True
    )
    solids = [Solid(solid, part.faces) for part in parts for solid in parts_of(part.shape, "SOLID")]
    for part in parts if solids else ():
        _require_solids(part, path)
    return solids


def _require_solids(part: Product, path: Path) -> None:
    """Raise :class:`InputError` if a face of ``part`` bounds no solid, as in a shell or a sheet."""
    of_solids = TopTools_IndexedMapOfShape()
    for solid in parts_of(part.shape, "SOLID"):
        TopExp.MapShapes_s(solid, of_solids)
    shells, faces = (
        [shape for shape in parts_of(part.shape, kind) if not of_solids.Contains(shape)] for kind in ("SHELL", "FACE")
    )
    if faces:
        closed = sum(shell.Closed() for shell in shells)
        raise InputError(
            f"{path}: {part.name[:_MOST_SHOWN]!r} has faces that bound no solid and would not count: {len(faces)}, in "
            f"shells: {len(shells)}, of which closed: {closed}; make solids of them in CAD, or leave them out"
        )


def join_base(body: Solid, base: CustomBase) -> Solid:
    """``body``, a lens without a base, and ``base`` as one solid; faces keep their names, others are ``BASE``.

    Raises :class:`InputError` if the base does not touch the lens, or covers or closes the cavity.
    """
    _require_placement(body, base)
    added = base.solid
    union = BRepAlgoAPI_Fuse(body.shape, added.shape)
    solids = parts_of(union.Shape(), "SOLID") if union.IsDone() else []
    if len(solids) != 1:
        raise InputError(f"{base.path}: makes {len(solids)} solids with the lens, not one; inspect where the two touch")
    if len(parts_of(solids[0], "SHELL")) != 1:
        raise InputError(f"{base.path}: closes the cavity; it must leave an opening below for the LED")
    sources = [*body.faces.items(), *((_name_of(face, added), face) for face in parts_of(added.shape, "FACE"))]
    faces = [(name, piece) for name, face in sources for piece in _pieces(union, face)]
    joined = Solid(solids[0], uniquely_named(faces))
    optical = {name for name in body.faces if name.startswith(optical_name(""))}
    change = abs(joined.volume_mm3 - body.volume_mm3 - added.volume_mm3)
    if not optical <= set(joined.faces) or change > _VOLUME_SHARE * added.volume_mm3:
        raise InputError(
            f"{base.path}: its union with the lens is {change:.3g} mm^3 off in volume; simplify the base's top"
        )
    return joined


def _name_of(face: Any, base: Solid) -> str:
    return next((name for name, base_face in base.faces.items() if base_face.IsSame(face)), BASE)


def _pieces(union: Any, face: Any) -> list[Any]:
    """Pieces of ``face`` in the union: the face itself, parts of it, or none where the two solids touch."""
    changed = [TopoDS.Face_s(piece) for piece in union.Modified(face)]
    if changed or union.IsDeleted(face):
        return changed
    return [face]


def _require_placement(body: Solid, base: CustomBase) -> None:
    """Require that the base leaves the cavity open in z = 0, and touches the ring between the rims."""
    import cadquery as cq

    ring = cq.Face(body.faces[RIM])
    (mouth,) = ring.innerWires()
    opening = cq.Face.makeFromWires(mouth)
    covered = _common_area(opening.wrapped, base.solid) / opening.Area()
    if covered > _COVERED_SHARE:
        raise InputError(
            f"{base.path}: covers {100.0 * covered:.3g} % of the cavity's opening; "
            f"it must leave free a circle of {2.0 * _largest_radius_mm(mouth):.4g} mm diameter about the axis in z = 0"
        )
    if _common_area(ring.wrapped, base.solid) <= _COVERED_SHARE * opening.Area():
        raise InputError(
            f"{base.path}: does not meet the lens, whose rim lies in z = 0 between {_largest_radius_mm(mouth):.4g} and "
            f"{_largest_radius_mm(ring.outerWire()):.4g} mm from the axis"
        )


def _top_mm(base: Solid) -> float:
    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(base.shape, box, False, False)
    return float(box.CornerMax().Z())


def _common_area(face: Any, base: Solid) -> float:
    import cadquery as cq

    common = BRepAlgoAPI_Common(face, base.shape)
    return float(sum(piece.Area() for piece in cq.Shape.cast(common.Shape()).Faces()))


def _largest_radius_mm(wire: Any) -> float:
    points = [wire.positionAt(k / 720.0) for k in range(720)]
    return float(max((point.x**2 + point.y**2) ** 0.5 for point in points))


def join_mesh(mesh: BodyMesh, base: CustomBase, chord_mm: float) -> BodyMesh:
    """``mesh`` and a mesh of ``base`` within ``chord_mm`` as one mesh; all of the base is the face ``BASE``.

    Raises :class:`InputError` where the CAD kernel's mesh of the base is not closed.
    """
    lens = manifold_of(mesh.vertices, mesh.triangles, mesh.face)
    vertices, triangles = tessellated(base.solid.shape, chord_mm)
    below = manifold_of(vertices, triangles, np.full(len(triangles), len(mesh.names)))
    if below.is_empty():
        raise InputError(f"{base.path}: the mesh of its solid is not closed; repair the solid in CAD")
    joined = (lens + below).to_mesh64()
    return BodyMesh(
        np.array(joined.vert_properties),  # a copy: the views of the library are read-only
        np.asarray(joined.tri_verts).astype(np.int64),
        np.asarray(joined.face_id).astype(np.int64),
        (*mesh.names, BASE),
        mesh.rings,
    )


def mesh_of_base(path: Path, chord_mm: float = 1e-2) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices and triangles of the base in the file ``path``, finer than a drawn line by default."""
    return tessellated(read_custom_base(path).solid.shape, chord_mm)
