"""The result of the geometry stage: the bytes of the part's files, and their errors, measured by reading them back."""

import hashlib
import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cached_property
from numbers import Real
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from lensforge.cad.face_tolerance import MAX_NODES, FaceTolerance
from lensforge.cad.part_limits import (
    MORE_RINGS,
    OTHER_RINGS,
    FormTolerance,
    KeepOutDistance,
    Signature,
    UntrimmedSurfaces,
    keep_out_remedy,
    mesh_volume_limit,
    round_trip_limit,
    state_of_mesh,
    step_face_limit,
)
from lensforge.cad.plate_result import (
    PLATE_FILES,
    PLATE_STEP_FILE,
    PLATE_STL_FILE,
    PLATE_THREEMF_FILE,
    Plate,
    plate_facts,
)
from lensforge.errors import InputError
from lensforge.public import public
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
from lensforge.results.figure import Criterion, Figure, facts_in, figure
from lensforge.results.numerals import quantity
from lensforge.results.plots import plot_outlines
from lensforge.results.record import InCriterion
from lensforge.scene.lens import Lens
from lensforge.spec import Spec

if TYPE_CHECKING:
    import cadquery
    import pyvista
    import trimesh
    from matplotlib.axes import Axes

_CONTENT = Field(strict=True, repr=False)
STEP_FILE = "lens.step"
STL_FILE = "lens.stl"
THREEMF_FILE = "lens.3mf"
SURFACES_FILE = "lens_surfaces.step"


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


def _finer_faces(part: "Part") -> str:
    larger = "raise manufacture.form_nm and normal_mrad"
    nodes = max(part.nodes.values())
    if nodes >= MAX_NODES:
        return f"{larger}: no spline is finer than this one of {nodes} nodes"
    return f"raise the number of nodes, or {larger}"


def _mend_solid(part: "Part") -> str:
    wrong = ", ".join(part.invalid_faces) or "the whole solid"
    return f"try another base.diameter_mm, or no base; not valid: {wrong}"


def _turned(part: "Part") -> str:
    """Largest angle by which the error of the normals turns light, compared with the LED's image."""
    tolerance = part.face_tolerance
    error = part.normal_error_mrad
    largest = f"largest; {quantity(error.rms, 'mrad', digits=2)} rms"
    moved = f"turns light by {quantity(tolerance.turn * error.max, 'mrad', digits=2)} at most"
    image = tolerance.image_mrad
    seen = "" if image is None else f", the LED’s image is {quantity(image, 'mrad', digits=2)} wide"
    return f"{largest}; {moved}{seen}"


def _untrimmed_limit(of: str, tolerance_field: str, cause: str) -> Criterion:
    """The limit on an error of the untrimmed faces: that of the part's faces, the field ``tolerance_field``."""
    return Criterion(
        "<=",
        lambda part: None if part.untrimmed_surfaces is None else getattr(part.face_tolerance, tolerance_field),
        f"{cause} of the untrimmed faces in their file",
        "raise the number of nodes, or lower the extension",
        name=f"surfaces_{cause.replace(' ', '_')}",
        of=of,
    )


def _keep_out_margin(part: "Part") -> float | None:
    limits = part.lens.spec.constraints
    return None if limits.keep_out is None else limits.keep_out_margin_mm


def _keep_out_tolerance(part: "Part") -> float:
    """Tolerance of the search, and the errors of both meshes."""
    measured = part.keep_out
    return 0.0 if measured is None else part.lens.spec.constraints.tolerance_mm + measured.error_mm


def _mesh_volume_limit(part: "Part") -> float:
    return mesh_volume_limit(part.area_mesh_mm2, 1e-3 * part.triangulation.chord_error_um, part.volume_mm3)


@public
class Part(StageResult):
    """Lens as a solid: the bytes of STEP, STL and 3MF, and their errors against the exact surfaces.

    Bytes that this process has not made itself are read within bounds, STEP and 3MF in a child process.

    ``lens``: of which it is made. ``face_tolerance``: largest errors allowed of the optical faces in the STEP.
    ``form_error_nm``, ``normal_error_mrad``: errors of these faces as read back. ``step_valid``,
    ``step_volume_change``: of the solid in the STEP as read back, the change relative. ``volume_mm3``, ``area_mm2``: of
    the solid. ``volume_mesh_mm3``, ``area_mesh_mm2``: of the mesh. ``mass_g``: None if the density is not known.
    ``keep_out``: distance to the solids to be kept clear of; None if the spec has none, or the mesh is not closed.
    ``bounds_mm``: least and largest corner of the box around the mesh; its vertices lie on the solid, whose box is
    larger by the chord error at most. ``watertight``, ``watertight_3mf``: the mesh is closed. ``genus``: its handles, 0
    for a lens. ``genus_difference``: from that of the solid. ``faces``: of the solid as read back. ``nodes``: of the
    spline of each optical face, by its name. ``step_schema``: of the STEP. ``form_tolerances``: those that the STEP
    carries on its faces, in AP242. ``signature``: author, organisation and date in its header. ``untrimmed_surfaces``:
    the faces extended beyond the rim, where wanted. ``triangulation``: size and errors of the mesh. ``plate``: the
    plate of all lenses, where the spec has one. ``files``: size and hash of each file, as built; ``altered`` names
    those that are others by now. ``invalid_faces``: names of faces that the CAD kernel finds wrong; no file keeps them.
    ``step``, ``stl``, ``threemf``: content of the files. ``surfaces_step``: content of the file of untrimmed faces.
    ``plate_step``, ``plate_stl``, ``plate_threemf``: content of the plate's files.
    """

    stage: ClassVar[str] = "export"

    lens: Annotated[Lens, Given()]
    face_tolerance: FaceTolerance
    form_error_nm: Annotated[
        Extent,
        Figure(
            "Form error", "largest of the optical faces in the STEP file; {form_error_nm.rms:2} rms", of="max", digits=2
        ),
        step_face_limit("form error", lambda part: part.face_tolerance.form_nm, _finer_faces),
    ]
    normal_error_mrad: Annotated[
        Extent,
        Figure("Error of the normals", _turned, of="max", digits=2),
        step_face_limit("normal error", lambda part: part.face_tolerance.normal_mrad, _finer_faces),
    ]
    step_valid: Annotated[
        Flag, InCriterion(), Criterion(">=", 1.0, "solid of the STEP file is valid (1: yes)", _mend_solid)
    ]
    step_volume_change: Annotated[
        NotNegative,
        InCriterion(),
        round_trip_limit("the STEP file", _finer_faces),
    ]
    watertight: Annotated[Flag, Criterion(">=", 1.0, "mesh (lens.stl) is closed (1: yes)", OTHER_RINGS)]
    watertight_3mf: Annotated[Flag, InCriterion(), Criterion(">=", 1.0, "3MF file is closed (1: yes)", OTHER_RINGS)]
    genus: Annotated[int, Field(strict=True)]
    genus_difference: Annotated[
        Count, InCriterion(), Criterion("<=", 0.0, "handles and holes that the mesh should not have", OTHER_RINGS)
    ]
    untrimmed_surfaces: Annotated[
        UntrimmedSurfaces | None,
        _untrimmed_limit("form_error_nm", "form_nm", "form error"),
        _untrimmed_limit("normal_error_mrad", "normal_mrad", "normal error"),
    ]
    keep_out: Annotated[
        KeepOutDistance | None,
        Figure("Keep-out distance", "of lens and base from the keep-out solid", of="distance_mm"),
        Criterion(
            ">=",
            _keep_out_margin,
            "distance of the part from the keep-out solid",
            lambda part: keep_out_remedy(part.lens.spec, part.keep_out),
            name="keep_out_distance",
            of="distance_mm",
            tolerance=_keep_out_tolerance,
        ),
    ] = None
    volume_mm3: Annotated[
        Number, Figure("Volume", lambda part: f"of the solid{included_holders(part.lens.spec)}", digits=5)
    ]
    volume_mesh_mm3: Number
    mass_g: Annotated[NotNegative | None, Figure("Mass", "volume times density", key="mass", unit="g")] = None
    area_mm2: NotNegative
    area_mesh_mm2: NotNegative
    bounds_mm: Box
    faces: Faces
    nodes: SplineNodes
    step_schema: Annotated[Literal["AP214", "AP242"], Figure("STEP schema", key="schema")]
    form_tolerances: tuple[FormTolerance, ...]
    signature: Signature
    triangulation: Triangulation
    plate: Plate | None = None
    files: dict[Text, FileStamp]
    seconds: NotNegative
    invalid_faces: Annotated[tuple[Text, ...], Field(exclude=True)] = ()
    criteria: Criteria = ()
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
        """Names of the files that are not as built: their hash differs from that in ``files``."""
        return tuple(name for name, content in self.exported.items() if self.files[name] != stamp_of(content))

    @property
    def exported(self) -> dict[str, bytes]:
        """Bytes of every existing file of the part, by name."""
        files = ((name, getattr(self, field)) for field, _, name in self._files(self.stage))
        return {name: content for name, content in files if content is not None}

    @property
    @figure(Criterion("<=", _mesh_volume_limit, "volume of the mesh (lens.stl), against the solid", MORE_RINGS))
    def mesh_volume_change(self) -> float:
        """Relative change of the volume by flat facets."""
        return abs(self.volume_mesh_mm3 / self.volume_mm3 - 1.0)

    @property
    @figure(Figure("Density", lambda part: f"by {part.lens.spec.lens.density.source}", unit="g/cm³"))
    def density(self) -> float | None:
        """Density of the material (g/cm³); None if it is not known."""
        stated = self.lens.spec.lens.density
        return None if stated is None else stated.g_per_cm3

    @property
    @figure(Figure("Mesh", "{triangulation.triangles} facets, genus {genus}", key="mesh"))
    def mesh_state(self) -> str:
        """Closed, open, or not made: the state of the mesh."""
        return state_of_mesh(self.watertight)

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


def included_holders(spec: Spec) -> str:
    """Base and flange that the solid includes, as a note; "" without either."""
    holders = {"base": spec.base_made.kind != "none", "flange": spec.lens.rim_flange is not None}
    included = " and ".join(name for name, is_there in holders.items() if is_there)
    return f", {included} included" if included else ""


def part_facts(part: Part) -> list[Group]:
    """One group on solid and files, and one on the plate."""
    facts = list(facts_in(part, part.criteria))
    of_plate = [fact for fact in facts if fact.key.startswith("plate_")]
    lens_facts: Iterable[Fact] = (fact for fact in facts if fact not in of_plate)
    spec = part.lens.spec
    if spec.plate is not None or not spec.all_lamps.is_single or spec.photometry.lenses > 1:
        lens_facts = (
            replace(fact, label=f"{fact.label} of a lens") if fact.key in _ALONE else fact for fact in lens_facts
        )
    groups = [Group("files", "Files as read back", (*lens_facts, *_mould(part), *_plate_elsewhere(part.lens)))]
    if part.plate is not None:
        sizes = {name: part.files[name].bytes for name in PLATE_FILES if name in part.files}
        groups.append(plate_facts(of_plate, sizes))
    return groups


_ALONE = ("volume", "mass")  # of one lens among several


def _plate_elsewhere(lens: Lens) -> Iterator[Fact]:
    if lens.spec.plate is not None and not lens.makes_plate:
        yield Fact("plate_files", "Plate", f"in the folder of the lens {lens.kinds[0].kind}, above this one")


def _mould(part: Part) -> Iterator[Fact]:
    """The scale of a mould insert, and the untrimmed faces that have it."""
    scale = part.lens.spec.manufacture.scale
    untrimmed = part.untrimmed_surfaces
    if untrimmed is not None:
        errors = f"form error {quantity(untrimmed.form_error_nm, 'nm', digits=2)}"
        normals = f"normals {quantity(untrimmed.normal_error_mrad, 'mrad', digits=2)}"
        beyond = f"{quantity(untrimmed.extension_deg, '°')} beyond the rim"
        yield Fact("surfaces", "Untrimmed faces", SURFACES_FILE, note=f"{beyond}; above it {errors}, {normals}")
    if scale != 1.0:
        carried = f"{SURFACES_FILE} has it" if untrimmed is not None else "`lensforge export --extension DEG` writes it"
        note = f"of the mould insert's faces; {STEP_FILE} is the moulded lens, {carried}"
        yield Fact("scale", "Scale of the mould", scale, note=note, digits=12)
