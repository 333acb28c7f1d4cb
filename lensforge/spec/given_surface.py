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

_EXPORTED_NM, _EXPORTED_URAD = 1.0, 20.0  # the largest errors of an exported face against the design

_Shift = tuple[Coordinate, Coordinate, Coordinate]
_FaceName = Annotated[int, Field(ge=1, le=100_000)] | Annotated[str, Field(min_length=1, max_length=200)]


class GivenSurface(FixedFace):
    """A face as it was read: its ``surface``, where it comes from, and its largest errors against that.

    A spec that names a file becomes this one as it is read, and needs the file no more.
    """

    kind: Literal["given"] = "given"
    origin: Label = ""
    """Origin of the face, in words."""
    form_error_nm: Annotated[float, Field(ge=0.0)] = 0.0
    """Largest distance of the surface from the face that was read."""
    normal_error_urad: Annotated[float, Field(ge=0.0)] = 0.0
    """Largest angle between the normals of both."""
    unit: Label = "mm"
    """Unit of the file that was read."""
    face: SurfaceRecord
    """The surface itself, as a record."""

    @property
    def title(self) -> str:
        """Words for its origin, and how well it is met."""
        if self.form_error_nm == 0.0 == self.normal_error_urad:
            return self.origin
        return f"{self.origin}, to {self.form_error_nm:.2g} nm and {self.normal_error_urad:.2g} µrad"

    @property
    def warnings(self) -> tuple[str, ...]:
        """A unit that was converted, and errors above those of an exported face."""
        unit = () if self.unit == "mm" else (f"{self.origin}: in {self.unit}, converted to mm",)
        if self.form_error_nm <= _EXPORTED_NM and self.normal_error_urad <= _EXPORTED_URAD:
            return unit
        return (
            *unit,
            f"{self.origin}: met to {self.form_error_nm:.3g} nm and {self.normal_error_urad:.3g} µrad; a smoother face "
            "or more points make it better",
        )

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
            unit=found.unit,
            face=surface_record(found.surface),
        )

    def _read(self) -> GivenFace:
        raise NotImplementedError


class FixedLensFace(_OfFile):
    """A face of another result. It is that face exactly."""

    kind: Literal["lens"] = "lens"
    file: Annotated[FilePath, AfterValidator(lens_file)]
    """Result folder, or its lens.json."""
    face: Literal["inner", "outer"]
    """Face of that lens."""

    def _read(self) -> GivenFace:
        return face_of_lens(self.file, self.face)


class FixedCadFace(_OfFile):
    """A face of a STEP or IGES file in the coordinates of the lens; any unit."""

    kind: Literal["cad"] = "cad"
    file: FilePath
    """STEP or IGES file."""
    face: _FaceName | Annotated[tuple[_FaceName, ...], Field(min_length=1, max_length=100)] = "first"
    """Face by its name, by its number in the file from 1, or "first", the one that the axis meets first above the
    origin; several where the face comes in parts.
    """
    shift_mm: _Shift = (0.0, 0.0, 0.0)
    """Shift of the file's face along x, y and z."""

    def _read(self) -> GivenFace:
        faces = self.face if isinstance(self.face, tuple) else (self.face,)
        return face_of_cad(self.file, faces, self.shift_mm)


class FixedPoints(_OfFile):
    """A face through the points of a text file, a grid or a cloud, in the coordinates of the lens.

    Points a little below z = 0 make the normals at the rim as good as elsewhere (those of a sphere 1 urad, else 20).
    """

    kind: Literal["points"] = "points"
    file: FilePath
    """Text file of points, one in each line."""
    coordinates: Literal["cartesian", "polar"] = "cartesian"
    """Columns: "cartesian", x, y, z in mm, or "polar", the angle from the axis and the azimuth in degrees and the
    distance from the origin in mm.
    """
    shift_mm: _Shift = (0.0, 0.0, 0.0)
    """Shift of the points along x, y and z."""

    def _read(self) -> GivenFace:
        return face_of_points(self.file, self.coordinates, self.shift_mm)
