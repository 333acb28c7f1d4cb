"""A fixed surface that is given: a face of another lens or of a CAD file, or points; read as the spec is read."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from lensforge.given_faces.cad_face import face_of_cad
from lensforge.given_faces.face import GivenFace
from lensforge.given_faces.lens_face import face_of_lens, lens_file
from lensforge.given_faces.points_face import face_of_points
from lensforge.spec.fixed_base import FixedFace
from lensforge.spec.section import Coordinate, FilePath, Label
from lensforge.surfaces.records import SurfaceRecord, surface_record
from lensforge.surfaces.surface import Surface

_Shift = tuple[Coordinate, Coordinate, Coordinate]
_FaceName = Annotated[int, Field(ge=1, le=100_000)] | Annotated[str, Field(min_length=1, max_length=200)]


class GivenSurface(FixedFace):
    """A face as it was read: its ``surface``, where it comes from, and its largest errors against that.

    A spec that names a file becomes this one as it is read, and needs the file no more.
    """

    kind: Literal["given"] = "given"
    origin: Label = ""
    form_error_nm: Annotated[float, Field(ge=0.0)] = 0.0
    normal_error_urad: Annotated[float, Field(ge=0.0)] = 0.0
    face: SurfaceRecord

    @property
    def surface(self) -> Surface:
        """The surface."""
        return self.face.surface()


class _OfFile(FixedFace):
    @property
    def surface(self) -> Surface:
        """The surface, read from its file."""
        return self.resolved().surface

    def resolved(self) -> GivenSurface:
        """The face of the file."""
        found = self._read()
        return GivenSurface(
            origin=found.origin[:200],
            form_error_nm=found.form_error_nm,
            normal_error_urad=found.normal_error_urad,
            face=surface_record(found.surface),
        )

    def _read(self) -> GivenFace:
        raise NotImplementedError


class FixedLensFace(_OfFile):
    """A ``face`` of another result: its folder, or its lens.json. It is that face exactly."""

    kind: Literal["lens"] = "lens"
    file: Annotated[FilePath, AfterValidator(lens_file)]
    face: Literal["inner", "outer"]

    def _read(self) -> GivenFace:
        return face_of_lens(self.file, self.face)


class FixedCadFace(_OfFile):
    """A face of a STEP or IGES ``file`` in the coordinates of the lens, after a shift by ``shift_mm``; any unit.

    ``face``: its name, its number in the file from 1, or "first", the one that the axis meets first above the origin;
    several where the face comes in parts.
    """

    kind: Literal["cad"] = "cad"
    file: FilePath
    face: _FaceName | Annotated[tuple[_FaceName, ...], Field(min_length=1, max_length=100)] = "first"
    shift_mm: _Shift = (0.0, 0.0, 0.0)

    def _read(self) -> GivenFace:
        faces = self.face if isinstance(self.face, tuple) else (self.face,)
        return face_of_cad(self.file, faces, self.shift_mm)


class FixedPoints(_OfFile):
    """A face through the points of a text ``file``, a grid or a cloud, in the coordinates of the lens after a shift.

    ``coordinates``: "cartesian", x, y, z in mm in each line, or "polar", the angle from the axis and the azimuth in
    degrees and the distance from the origin in mm.
    """

    kind: Literal["points"] = "points"
    file: FilePath
    coordinates: Literal["cartesian", "polar"] = "cartesian"
    shift_mm: _Shift = (0.0, 0.0, 0.0)

    def _read(self) -> GivenFace:
        return face_of_points(self.file, self.coordinates, self.shift_mm)
