"""The geometry stage: STEP, STL and 3MF from a lens record, and their errors, measured by reading them back.

The STEP file has the header, and as AP242 the tolerances, that the spec asks for. Area and box of the part as exported
are kept, so that its files can be compared with them when they come back from elsewhere. Untrimmed faces, by which a
shop cuts a mould, must keep the limits of the faces of the part.
"""

import time

from lensforge.cad.body_export import BuiltBody, on_base
from lensforge.cad.boundary import Pair
from lensforge.cad.custom_base import read_custom_base
from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.drawn_body import DrawnBody, drawn_body
from lensforge.cad.face_tolerance import FaceTolerance, face_tolerance
from lensforge.cad.facets import CHORD_MM
from lensforge.cad.flange import ring_of
from lensforge.cad.form_error import face_error, fit_lens, rounded_to, worst
from lensforge.cad.keep_out import keep_out_distance, mesh_error_mm, read_keep_out
from lensforge.cad.mesh import MIN_RINGS
from lensforge.cad.mesh_files import stl_bytes, threemf_bytes
from lensforge.cad.part import STEP_FILE, STL_FILE, SURFACES_FILE, THREEMF_FILE, Faces, Part, Triangulation, stamp_of
from lensforge.cad.part_limits import (
    KeepOutDistance,
    Signature,
    UntrimmedSurfaces,
    mass_g,
)
from lensforge.cad.patch import Patch, fit_extended
from lensforge.cad.plan import Plan
from lensforge.cad.plate_export import LensOfPlate, build_plate
from lensforge.cad.plate_result import PLATE_STEP_FILE, PLATE_STL_FILE, PLATE_THREEMF_FILE
from lensforge.cad.solid import untrimmed_faces
from lensforge.cad.step import parse_surfaces, parts_bytes, require_schema, signed_step
from lensforge.errors import InputError
from lensforge.optics.face_roles import BODY, CAVITY
from lensforge.results import Extent
from lensforge.scene.lens import Lens
from lensforge.spec.accuracy import preset_of
from lensforge.surfaces.step_file import Schema, parts_of
from lensforge.surfaces.surface import scaled


def build_part(
    lens: Lens,
    *,
    nodes: int | None = None,
    tolerance: FaceTolerance | None = None,
    rings: int | None = None,
    chord_mm: float = CHORD_MM,
    least_rings: int = MIN_RINGS,
    schema: Schema = "AP214",
    extension_deg: float | None = None,
    date: str | None = None,
) -> Part:
    """Make the part: the bytes of STEP, STL and 3MF, and their errors, measured by reading these bytes back.

    ``nodes``: spline nodes across each optical face, by default as many as their ``tolerance`` needs, by default that
    of the lens.
    ``rings``: equal rings of the mesh; by default those of the lens's preset, or as many as the faces' detail needs,
    their facets split where they are more than ``chord_mm`` (mm) from the surface, and at least ``least_rings``.
    ``extension_deg``: also write ``lens_surfaces.step``, the optical faces untrimmed and extended by this angle
    (degrees) beyond the rim, where the tool runs off; those of a mould insert are scaled by 1 + shrinkage.
    ``date``: of the files, by default ``manufacture.date``; an AP242 part carries ``manufacture.form_tolerance_um``.
    Missed criteria do not raise. Raises :class:`InputError` for a lens that cannot be built: a wall that is not
    positive, a base too narrow for the cavity, a base's file that does not fit the lens.
    """
    start = time.perf_counter()
    require_schema(schema)
    rings = preset_of(lens.accuracy).part.mesh_rings if rings is None else rings
    tolerance = tolerance or face_tolerance(lens)
    body = _drawn(lens, tolerance, nodes)
    whole = None
    if body is None:
        pair = fit_lens(lens, *([] if nodes is None else [nodes] * len(lens.surfaces)), tolerance=tolerance)
        body = whole = _build(lens, pair, rings, chord_mm, least_rings)
    name = lens.spec.name
    signed = signed_step(body.solid, lens.spec, name, schema, date)
    step = signed.content
    untrimmed = None
    surfaces_step = None
    if extension_deg is not None:
        if whole is None:
            raise InputError(
                f"extension = {extension_deg:g}: a linear lens has no faces beyond its section; leave it out"
            )
        untrimmed, surfaces_step = _untrimmed(lens, whole.plan, tolerance, extension_deg, schema, signed.signature)
    stl = stl_bytes(body.mesh)
    threemf = threemf_bytes(body.mesh, name)
    proof = body.prove(step, stl, threemf)
    form = worst(list(proof.form.values()))
    keep_out = plate = None
    if whole is not None:
        keep_out = _keep_out(lens, whole)
        lens_of_plate = LensOfPlate(whole.plan, form.form_max_nm, proof.solid.volume_mm3)
        plate = build_plate(lens, lens_of_plate, nodes, tolerance, schema, date)
    files = {STEP_FILE: step, STL_FILE: stl, THREEMF_FILE: threemf} | ({} if plate is None else dict(plate.files))
    if surfaces_step is not None:
        files[SURFACES_FILE] = surfaces_step
    return Part(
        inputs={"lens": lens.sha256},
        lens=lens,
        form_error_nm=Extent(max=form.form_max_nm, rms=form.form_rms_nm),
        face_tolerance=tolerance,
        normal_error_mrad=Extent(max=form.normal_max_mrad, rms=form.normal_rms_mrad),
        volume_mm3=proof.solid.volume_mm3,
        volume_mesh_mm3=proof.stl.volume_mm3,
        mass_g=mass_g(lens.spec, proof.solid.volume_mm3),
        keep_out=keep_out,
        area_mm2=proof.solid.area_mm2,
        area_mesh_mm2=body.mesh.area(),
        bounds_mm=body.mesh.bounds_mm,
        step_valid=proof.solid.valid,
        step_volume_change=abs(proof.solid.default_volume_mm3 / body.solid.default_volume_mm3 - 1.0),
        watertight=proof.stl.watertight,
        watertight_3mf=proof.threemf.watertight,
        genus=proof.stl.genus,
        genus_difference=abs(proof.stl.genus - proof.solid.genus),
        faces=Faces(count=len(parts_of(proof.solid.shape, "FACE")), names=tuple(sorted(proof.solid.faces))),
        nodes=dict(body.nodes),
        step_schema=schema,
        form_tolerances=signed.tolerances,
        signature=signed.signature,
        untrimmed_surfaces=untrimmed,
        plate=None if plate is None else plate.figures,
        triangulation=Triangulation(
            triangles=len(body.mesh.triangles),
            vertices=len(body.mesh.vertices),
            rings=body.mesh.rings,
            chord_error_um=1e3 * body.chord_mm,
        ),
        files={name: stamp_of(content) for name, content in files.items()},
        seconds=round(time.perf_counter() - start, 3),
        invalid_faces=proof.solid.faults,
        step=step,
        stl=stl,
        threemf=threemf,
        surfaces_step=surfaces_step,
        plate_step=files.get(PLATE_STEP_FILE),
        plate_stl=files.get(PLATE_STL_FILE),
        plate_threemf=files.get(PLATE_THREEMF_FILE),
    )


def _drawn(lens: Lens, tolerance: FaceTolerance, nodes: int | None) -> BuiltBody | DrawnBody | None:
    """The body of a lens whose faces are profiles drawn along y; None for any other."""
    length_mm = lens.spec.lens.drawn_mm
    if length_mm is None:
        return None
    if lens.spec.lens.has_creases:
        lens.body.require_sound()
    return drawn_body(lens.body.arcs(CAVITY), lens.body.arcs(BODY), length_mm, tolerance, nodes)


def _build(lens: Lens, pair: Pair[Patch], rings: int | None, chord_mm: float, least_rings: int) -> BuiltBody:
    """Build mesh and solid of the fitted faces, and join a base from a file."""
    custom = None if lens.spec.base.file is None else read_custom_base(lens.spec.base.file)
    base = base_with_room(lens)
    ring = ring_of(lens, pair[1])
    return on_base(lens.surfaces, pair, base, rings, chord_mm, custom, ring, least_rings)


def _keep_out(lens: Lens, body: BuiltBody) -> KeepOutDistance | None:
    path = lens.spec.constraints.keep_out
    if path is None:
        return None
    error_mm = mesh_error_mm(lens.spec.base, body.mesh.rings, body.chord_mm)
    return keep_out_distance(body.mesh, read_keep_out(path), error_mm)


def _untrimmed(
    lens: Lens, plan: Plan[Patch], tolerance: FaceTolerance, extension_deg: float, schema: Schema, header: Signature
) -> tuple[UntrimmedSurfaces, bytes]:
    """The untrimmed faces as a separate STEP file, and their form error above the rim as read back."""
    scale = lens.spec.manufacture.scale
    optical = [face for face in plan.faces if not face.is_flange]
    surfaces = {face.label: scaled(lens.surfaces[face.name], scale) for face in optical}
    patches = {
        face.label: rounded_to(
            fit_extended(surfaces[face.label], face.shape.nodes, extension_deg, face.domain.extent), tolerance
        )
        for face in optical
    }
    envelope = [face.label for face in plan.envelope.faces]
    product = f"{lens.spec.name} surfaces"
    if scale != 1.0:
        product = f"{lens.spec.name} surfaces of the mould, the lens scaled by {scale:.12g}"
    content = parts_bytes(untrimmed_faces(patches, envelope), {}, product, schema, header, ())
    faces = parse_surfaces(content)
    domains = [(face.label, face.domain) for face in optical]
    form = worst([face_error(surfaces[label], faces[label], domain=domain) for label, domain in domains])
    untrimmed = UntrimmedSurfaces(
        extension_deg=extension_deg, scale=scale, form_error_nm=form.form_max_nm, normal_error_mrad=form.normal_max_mrad
    )
    return untrimmed, content
