"""The result of the geometry stage: the bytes of the part's files, and their errors, measured by reading them back."""

import hashlib
import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from numbers import Real
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from lensforge.cad.face_tolerance import FaceTolerance
from lensforge.cad.part_limits import FormTolerance, KeepOutDistance, Signature, UntrimmedSurfaces
from lensforge.cad.plate_result import (
    PLATE_FILES,
    PLATE_STEP_FILE,
    PLATE_STL_FILE,
    PLATE_THREEMF_FILE,
    Plate,
    plate_facts,
)
from lensforge.errors import InputError
from lensforge.results import (
    BodySize,
    Box,
    Count,
    Extent,
    Fact,
    Flag,
    Given,
    Group,
    InFile,
    NotNegative,
    Number,
    Record,
    Sha256,
    StageResult,
    Text,
)
from lensforge.results.criteria import Criteria
from lensforge.results.fact_table import Row, facts_of
from lensforge.results.numerals import quantity
from lensforge.results.plots import plot_outlines
from lensforge.scene.lens import Lens
from lensforge.spec import Spec

if TYPE_CHECKING:
    import cadquery
    import pyvista
    import trimesh
    from matplotlib.axes import Axes

_CONTENT = Field(strict=True, repr=False)
STEP_FILE, STL_FILE, THREEMF_FILE, SURFACES_FILE = "lens.step", "lens.stl", "lens.3mf", "lens_surfaces.step"


class FileStamp(Record):
    """Size and hash of a file."""

    bytes: Count
    sha256: Sha256


def stamp_of(content: bytes) -> FileStamp:
    """Size and hash of ``content``."""
    return FileStamp(bytes=len(content), sha256=hashlib.sha256(content).hexdigest())


class Faces(Record):
    """Count and names of the faces of the solid as read back."""

    count: Count
    names: tuple[Text, ...]


SplineNodes = dict[Text, Count]  # across each optical face, by its name


class Triangulation(Record):
    """Size of the mesh, and the largest distance of its facets from the optical surfaces."""

    triangles: Count
    vertices: Count
    rings: Count
    chord_error_um: NotNegative


class Part(StageResult):
    """Lens as a solid: the bytes of STEP, STL and 3MF, and their errors against the exact surfaces.

    Bytes that this process has not made itself are read within bounds, STEP and 3MF in a child process.

    ``lens``: of which it is made. ``face_tolerance``: largest errors allowed of the optical faces in the STEP.
    ``form_error_nm``, ``normal_error_mrad``: errors of these faces as read back. ``volume_mm3``, ``area_mm2``: of the
    solid. ``volume_mesh_mm3``, ``area_mesh_mm2``: of the mesh. ``mass_g``: None where the density is not known.
    ``keep_out``: distance to the solids to be kept clear of; None where the spec has none, or the mesh is not closed.
    ``bounds_mm``: least and largest corner of the box around the mesh; its vertices lie on the solid, whose box is
    larger by the chord error at most. ``watertight``: the mesh is closed. ``genus``: its handles, 0 for a lens.
    ``faces``: of the solid as read back. ``nodes``: of the spline of each optical face, by its name. ``step_schema``:
    of the STEP. ``form_tolerances``: those that the STEP carries on its faces, in AP242. ``signature``: author,
    organisation and date in its header. ``untrimmed_surfaces``: the faces extended beyond the rim, where
    wanted. ``triangulation``: size and errors of the mesh. ``plate``: the plate of all lenses, where the spec has
    one. ``files``: size and hash of each file, as built; ``altered`` names those that are others by now. ``step``,
    ``stl``, ``threemf``: content of the files. ``surfaces_step``: content of the file of untrimmed faces.
    ``plate_step``, ``plate_stl``, ``plate_threemf``: content of the plate's files.
    """

    stage: ClassVar[str] = "export"

    lens: Annotated[Lens, Given()]
    face_tolerance: FaceTolerance
    form_error_nm: Extent
    normal_error_mrad: Extent
    volume_mm3: Number
    volume_mesh_mm3: Number
    mass_g: NotNegative | None = None
    keep_out: KeepOutDistance | None = None
    area_mm2: NotNegative
    area_mesh_mm2: NotNegative
    bounds_mm: Box
    watertight: Flag
    genus: Annotated[int, Field(strict=True)]
    faces: Faces
    nodes: SplineNodes
    step_schema: Literal["AP214", "AP242"]
    form_tolerances: tuple[FormTolerance, ...]
    signature: Signature
    untrimmed_surfaces: UntrimmedSurfaces | None
    triangulation: Triangulation
    plate: Plate | None = None
    files: dict[Text, FileStamp]
    seconds: NotNegative
    criteria: Criteria
    step: Annotated[bytes, InFile(STEP_FILE), _CONTENT]
    stl: Annotated[bytes, InFile(STL_FILE), _CONTENT]
    threemf: Annotated[bytes, InFile(THREEMF_FILE), _CONTENT]
    surfaces_step: Annotated[bytes | None, InFile(SURFACES_FILE), _CONTENT] = None
    plate_step: Annotated[bytes | None, InFile(PLATE_STEP_FILE), _CONTENT] = None
    plate_stl: Annotated[bytes | None, InFile(PLATE_STL_FILE), _CONTENT] = None
    plate_threemf: Annotated[bytes | None, InFile(PLATE_THREEMF_FILE), _CONTENT] = None

    @model_validator(mode="after")
    def _files_are_those_of_the_record(self) -> "Part":
        contents = self.exported
        for name in {**self.files, **contents}:
            if name not in contents:
                raise ValueError(f"{name}: no such file, export.json describes one")
            if name not in self.files:
                raise ValueError(f"{name}: not a file that export.json describes")
        return self

    @cached_property
    def altered(self) -> tuple[str, ...]:
        """Names of the files that are not as built: their bytes have another hash than ``files`` states."""
        return tuple(name for name, content in self.exported.items() if self.files[name] != stamp_of(content))

    @property
    def exported(self) -> dict[str, bytes]:
        """Bytes of every file of the part that there is, by its name."""
        each = ((name, getattr(self, field)) for field, _, name in self._files(self.stage))
        return {name: content for name, content in each if content is not None}

    @property
    def closed_or_not(self) -> str:
        """State of the mesh in words."""
        return "closed" if self.watertight else "not closed"

    @property
    def size(self) -> BodySize:
        """Size of the solid as exported, whatever the files are now."""
        return BodySize(volume_mm3=self.volume_mm3, area_mm2=self.area_mm2, bounds_mm=self.bounds_mm)

    @cached_property
    def solid(self) -> "cadquery.Solid":
        """Part as a ``cadquery.Solid`` (mm), read from the STEP: cut it, fuse it, save it with cadquery."""
        import cadquery

        from lensforge.cad.step import parse_step

        return cadquery.Solid(parse_step(self.step).shape)

    @cached_property
    def mesh(self) -> "trimesh.Trimesh":
        """Part as a ``trimesh.Trimesh`` (mm), read from the STL, equal vertices merged."""
        import trimesh

        from lensforge.cad.mesh_files import parse_stl

        return trimesh.Trimesh(*parse_stl(self.stl), process=False)

    def products(self) -> dict[str, bytes]:
        """STEP, STL and 3MF by suffix: the bytes whose errors were measured."""
        return {".step": self.step, ".stp": self.step, ".stl": self.stl, ".3mf": self.threemf}

    def plot(self, axes: "Axes | None" = None, *, azimuth_deg: float = 0.0) -> "Axes":
        """Draw the section through the axis at ``azimuth_deg``, to scale. Raises :class:`InputError` for no number."""
        from lensforge.cad.section import body_outlines

        if not isinstance(azimuth_deg, Real) or not math.isfinite(azimuth_deg):
            raise InputError(f"azimuth_deg = {azimuth_deg!r}: must be a finite number of degrees")
        return plot_outlines(body_outlines(self.lens, azimuth_deg), f"across the axis at {azimuth_deg:g}°", axes)

    def show(self, *, cut: bool = False, off_screen: bool | None = None) -> "pyvista.Plotter":
        """Show the mesh in three dimensions, ``cut`` at y = 0; a ``pyvista.Plotter``, shown unless ``off_screen``."""
        import pyvista

        mesh = pyvista.wrap(self.mesh)
        if cut:
            mesh = mesh.clip_closed_surface(normal="-y", origin=(0.0, 0.0, 0.0))  # open towards the camera
        plotter = pyvista.Plotter(off_screen=off_screen)
        plotter.add_mesh(mesh, color="#a3bfd8", smooth_shading=True, split_sharp_edges=True, feature_angle=35.0)
        plotter.renderer.add_axes()
        if not off_screen:
            plotter.show()
        return plotter


def held_by(spec: Spec) -> str:
    """Words on what holds the lens and counts as part of its solid; empty where nothing does."""
    holders = {"base": spec.base_made.kind != "none", "flange": spec.lens.rim_flange is not None}
    there = " and ".join(name for name, is_there in holders.items() if is_there)
    return f", {there} included" if there else ""


def part_facts(part: Part) -> list[Group]:
    """One group on solid and files, and one on the plate."""
    density = part.lens.spec.lens.density
    words = {
        "source": "" if density is None else density.source,
        "turned": _turned(part),
        "held": held_by(part.lens.spec),
    }
    table = facts_of(part, _FILES, judged=part.criteria, **words)
    spec, alone = part.lens.spec, ("volume", "mass")
    if spec.plate is not None or not spec.all_lamps.is_single or spec.photometry.lenses > 1:
        table = (replace(fact, label=f"{fact.label} of a lens") if fact.key in alone else fact for fact in table)
    groups = [Group("files", "Files as read back", (*table, *_mould(part), *_plate_elsewhere(part.lens)))]
    if part.plate is not None:
        sizes = {name: part.files[name].bytes for name in PLATE_FILES if name in part.files}
        groups.append(plate_facts(part.plate, part.criteria, sizes))
    return groups


_FILES = (
    Row(
        "form_error",
        "Form error",
        "form_error_nm.max",
        "largest of the optical faces in the STEP file; {form_error_nm.rms:2} rms",
        digits=2,
        like="form_error",
    ),
    Row(
        "normal_error",
        "Error of the normals",
        "normal_error_mrad.max",
        "largest; {normal_error_mrad.rms:2} rms; {turned}",
        digits=2,
        like="normal_error",
    ),
    Row(
        "keep_out",
        "Keep-out distance",
        "keep_out.distance_mm",
        "of lens and base from the keep-out solid",
        like="keep_out_distance",
    ),
    Row("volume", "Volume", "volume_mm3", "of the solid{held}", digits=5),
    Row("density", "Density", "lens.spec.lens.density.g_per_cm3", "by {source}", "g/cm³"),
    Row("mass", "Mass", "mass_g", "volume times density", "g"),
    Row("mesh", "Mesh", "closed_or_not", "{triangulation.triangles} facets, genus {genus}"),
    Row("schema", "STEP schema", "step_schema"),
)


def _plate_elsewhere(lens: Lens) -> Iterator[Fact]:
    if lens.spec.plate is not None and not lens.makes_plate:
        yield Fact("plate_files", "Plate", f"in the folder of the lens {lens.kinds[0].kind}, above this one")


def _turned(part: Part) -> str:
    """The angle by which the error of the normals turns light at most, beside the image of the LED."""
    tolerance = part.face_tolerance
    moved = f"turns light by {quantity(tolerance.turn * part.normal_error_mrad.max, 'mrad', digits=2)} at most"
    image = tolerance.image_mrad
    return moved if image is None else f"{moved}, the LED’s image is {quantity(image, 'mrad', digits=2)} wide"


def _mould(part: Part) -> Iterator[Fact]:
    """The scale that a mould insert asks for, and the untrimmed faces that have it."""
    scale, untrimmed = part.lens.spec.manufacture.scale, part.untrimmed_surfaces
    if untrimmed is not None:
        errors = f"form error {quantity(untrimmed.form_error_nm, 'nm', digits=2)}"
        normals = f"normals {quantity(untrimmed.normal_error_mrad, 'mrad', digits=2)}"
        beyond = f"{quantity(untrimmed.extension_deg, '°')} beyond the rim"
        yield Fact("surfaces", "Untrimmed faces", SURFACES_FILE, note=f"{beyond}; above it {errors}, {normals}")
    if scale != 1.0:
        carried = f"{SURFACES_FILE} has it" if untrimmed is not None else "`lensforge export --extension DEG` writes it"
        note = f"of the mould insert's faces; {STEP_FILE} is the moulded lens, {carried}"
        yield Fact("scale", "Scale of the mould", scale, note=note, digits=12)
