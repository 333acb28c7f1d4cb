"""The ``fixed`` of a face, such as ``[lens.inner.fixed]``: a surface that the search does not change.

It is given by a formula, as a face of another lens or of a CAD file, or as points; files are read as the spec is
read.
"""

from functools import lru_cache
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field

from lensforge.public import public
from lensforge.results.registered_kinds import OfSeveralKinds
from lensforge.spec.spec_section import Coordinate, FilePath, Label, Millimetres, Section, check, fault_of
from lensforge.surfaces.asphere import Asphere, Biconic, SurfaceShape
from lensforge.surfaces.imported_face import GivenFace, face_of_cad, face_of_lens, lens_file
from lensforge.surfaces.point_cloud import face_of_points
from lensforge.surfaces.reciprocal import ConicFace
from lensforge.surfaces.surface import Surface, SurfaceRecord, surface_record


@public
class FixedFace(OfSeveralKinds, Section):
    """A surface that the search does not change. A kind of it is a class that extends this one: it registers itself."""

    is_round: ClassVar[bool] = False  # of revolution about the axis

    @property
    def surface(self) -> Surface:
        """The surface. Raises :class:`InputError` where it is not star-shaped about the origin."""
        raise NotImplementedError

    @property
    def title(self) -> str:
        """Display name of the surface."""
        return self.kind.replace("_", " ")

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line for each matter that a user should know of before the search."""
        return ()

    @property
    def shape(self) -> SurfaceShape:
        """Its shape over the hemisphere."""
        return _shape_of(self)

    @property
    def apex_mm(self) -> float:
        """Height at which it meets the axis."""
        return float(self.shape.radii_mm[0, 0])

    def resolved(self) -> "FixedFace":
        """The face with what its file holds. Raises :class:`InputError` for a file that does not hold it."""
        return self


@lru_cache(maxsize=8)
def _shape_of(face: FixedFace) -> SurfaceShape:
    return SurfaceShape(face.surface)


_Conic = Annotated[float, Field(ge=-1e3, le=1e3)]
_Series = Annotated[tuple[Coordinate, ...], Field(max_length=10)]


@public
class _ByFormula(FixedFace):
    """A surface that a formula gives; it must be star-shaped about the origin."""

    @check
    def _is_star_shaped(self) -> None:
        with fault_of():
            _ = self.surface


@public
class FixedSphere(_ByFormula):
    """Sphere with its centre on the axis; the origin, where the source is, must lie inside."""

    is_round: ClassVar[bool] = True

    kind: Literal["sphere"] = "sphere"
    radius_mm: Millimetres = Field(description="Radius.")
    centre_z_mm: Coordinate = Field(
        default=0.0, description="Height of the centre above z = 0; the origin must lie inside the sphere."
    )

    @property
    def surface(self) -> Surface:
        """Surface about the axis."""
        return Asphere(self.centre_z_mm + self.radius_mm, -self.radius_mm)


@public
class FixedAsphere(_ByFormula):
    """Even asphere by the sag of ISO 10110-12."""

    is_round: ClassVar[bool] = True

    kind: Literal["asphere"] = "asphere"
    vertex_z_mm: Millimetres = Field(description="Height of the vertex above z = 0.")
    radius_mm: Coordinate = Field(description="Radius of curvature at the vertex, below 0 for a dome over the source.")
    conic_constant: _Conic = Field(default=0.0, description="Conic constant: 0 a sphere, -1 a paraboloid.")
    coefficients: _Series = Field(default=(), description="Coefficients A_4, A_6, A_8, ... in mm^-3, mm^-5, mm^-7, ...")

    @property
    def surface(self) -> Surface:
        """Surface about the axis."""
        return Asphere(self.vertex_z_mm, self.radius_mm, self.conic_constant, self.coefficients)


@public
class FixedBiconic(_ByFormula):
    """Biconic (ISO 10110-12): radii and conic constants in the x-z and in the y-z plane; below 0 for a dome."""

    kind: Literal["biconic"] = "biconic"
    vertex_z_mm: Millimetres = Field(description="Height of the vertex above z = 0.")
    radius_x_mm: Coordinate = Field(description="Radius of curvature in the x-z plane.")
    radius_y_mm: Coordinate = Field(description="Radius of curvature in the y-z plane.")
    conic_x: _Conic = Field(default=0.0, description="Conic constant in the x-z plane.")
    conic_y: _Conic = Field(default=0.0, description="Conic constant in the y-z plane.")

    @property
    def surface(self) -> Surface:
        """Surface with its vertex on the axis."""
        radii = (self.radius_x_mm, self.radius_y_mm)
        conics = (self.conic_x, self.conic_y)
        return Biconic(self.vertex_z_mm, *radii, *conics)


_FARTHEST = 64.0  # reach of a paraboloid over its vertex
_ROOM = 1.1  # of an ellipsoid over its farthest point


@public
class FixedFocalConic(_ByFormula):
    """Conic of revolution with a focus at the origin, where the LED is, and its vertex below: a reflector's cup.

    A paraboloid sends the light of its focus along the axis, an ellipsoid to its other focus.
    """

    is_round: ClassVar[bool] = True

    kind: Literal["focal_conic"] = "focal_conic"
    vertex_mm: Millimetres = Field(
        description="Distance of the vertex below the focus: the focal length of a paraboloid, whose radius at z "
        "= 0 is twice that."
    )
    second_focus_mm: Millimetres | None = Field(
        default=None, description="Height of the other focus of an ellipsoid; without it a paraboloid."
    )

    @property
    def surface(self) -> Surface:
        """Surface about the axis: semi-axis a = f + c, eccentricity c/a, parameter (a^2 - c^2)/a, f the vertex."""
        half = None if self.second_focus_mm is None else 0.5 * self.second_focus_mm
        if half is None:
            return ConicFace(_FARTHEST * self.vertex_mm, 2.0 * self.vertex_mm, 1.0)
        axis = self.vertex_mm + half
        return ConicFace(_ROOM * (axis + half), (axis - half) * (axis + half) / axis, half / axis)


_Shift = tuple[Coordinate, Coordinate, Coordinate]
_FaceName = Annotated[int, Field(ge=1, le=100_000)] | Annotated[str, Field(min_length=1, max_length=200)]


@public
class _OfFile(FixedFace):
    @property
    def surface(self) -> Surface:
        """The surface, read from its file."""
        return self.resolved().surface

    def resolved(self) -> "GivenSurface":
        """The face of the file."""
        given = self._read()
        errors = {name: getattr(given, name) for name in ("form_error_nm", "normal_error_urad")}
        return GivenSurface(origin=given.origin[:200], **errors, unit=given.unit, face=surface_record(given.surface))

    def _read(self) -> GivenFace:
        raise NotImplementedError


@public
class FixedLensFace(_OfFile):
    """A face of another result. It is that face exactly."""

    kind: Literal["lens"] = "lens"
    file: Annotated[FilePath, AfterValidator(lens_file)] = Field(description="Result folder, or its lens.json.")
    face: Annotated[str, Field(min_length=1, max_length=200)] = Field(
        description="Face of that lens by its name, such as inner, outer, or exit."
    )

    def _read(self) -> GivenFace:
        return face_of_lens(self.file, self.face)


@public
class FixedCadFace(_OfFile):
    """A face of a STEP or IGES file in the coordinates of the lens; any unit."""

    kind: Literal["cad"] = "cad"
    file: FilePath = Field(description="STEP or IGES file.")
    face: _FaceName | Annotated[tuple[_FaceName, ...], Field(min_length=1, max_length=100)] = Field(
        default="first",
        description='Face by its name, by its number in the file from 1, or "first": the face that the axis meets '
        "first above the origin. Several where the face comes in parts.",
    )
    shift_mm: _Shift = Field(default=(0.0, 0.0, 0.0), description="Shift of the file's face along x, y and z.")

    def _read(self) -> GivenFace:
        faces = self.face if isinstance(self.face, tuple) else (self.face,)
        return face_of_cad(self.file, faces, self.shift_mm)


@public
class FixedPoints(_OfFile):
    """A face through the points of a text file, a grid or a cloud, in the coordinates of the lens.

    Points a little below z = 0 give the rim accurate normals (errors on a sphere: 1 urad, else 20).
    """

    kind: Literal["points"] = "points"
    file: FilePath = Field(description="Text file of points, one in each line.")
    coordinates: Literal["cartesian", "polar"] = Field(
        default="cartesian",
        description='Columns: "cartesian", x, y, z in mm, or "polar", the angle from the axis and the azimuth in '
        "degrees and the distance from the origin in mm.",
    )
    shift_mm: _Shift = Field(default=(0.0, 0.0, 0.0), description="Shift of the points along x, y and z.")

    def _read(self) -> GivenFace:
        return face_of_points(self.file, self.coordinates, self.shift_mm)


# The largest errors of an exported face against the design.
_EXPORTED_NM = 1.0
_EXPORTED_URAD = 20.0


@public
class GivenSurface(FixedFace):
    """A face as it was read: its ``surface``, where it comes from, and its largest errors against that.

    A spec that names a file becomes this one as it is read, and needs the file no more.
    """

    kind: Literal["given"] = "given"
    origin: Label = Field(default="", description="Origin of the face, in words.")
    form_error_nm: Annotated[float, Field(ge=0.0)] = Field(
        default=0.0, description="Largest distance of the surface from the face that was read."
    )
    normal_error_urad: Annotated[float, Field(ge=0.0)] = Field(
        default=0.0, description="Largest angle between the normals of both."
    )
    unit: Label = Field(default="mm", description="Unit of the file that was read.")
    face: SurfaceRecord = Field(description="The surface itself, as a record.")

    @property
    def title(self) -> str:
        """Display name: the file of the surface, and how well it is approximated."""
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


def _resolved(face: FixedFace) -> FixedFace:
    """The face itself in place of the file that holds it: a spec needs that file no more."""
    with fault_of():
        return face.resolved()


FixedSurface = Annotated[FixedFace, AfterValidator(_resolved)]
