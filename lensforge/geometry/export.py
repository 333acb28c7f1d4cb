"""The geometry stage: STEP, STL and 3MF from a lens record, and their errors, measured by reading them back."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from lensforge.cad_files.step_settings import Schema
from lensforge.criteria import Criterion
from lensforge.geometry.acceptance import mass_g, mesh_volume_limit, part_criteria
from lensforge.geometry.base_profile import INNER, OUTER
from lensforge.geometry.custom_base import join_mesh, read_custom_base
from lensforge.geometry.cutter_room import base_with_room
from lensforge.geometry.facet_error import FacetError
from lensforge.geometry.form import FormError, Place, face_error, fit_faces, worst
from lensforge.geometry.keep_out import read_keep_out
from lensforge.geometry.keep_out_criterion import keep_out_criteria
from lensforge.geometry.keep_out_distance import keep_out_distance
from lensforge.geometry.keep_out_error import mesh_error_mm
from lensforge.geometry.mesh import BodyMesh, build_mesh, mesh_error
from lensforge.geometry.mesh_files import parse_3mf, parse_stl, stl_bytes, threemf_bytes
from lensforge.geometry.part import (
    STEP_FILE,
    STL_FILE,
    SURFACES_FILE,
    THREEMF_FILE,
    Faces,
    KeepOutDistance,
    Part,
    SplineNodes,
    Triangulation,
    UntrimmedSurfaces,
    stamp_of,
)
from lensforge.geometry.patch import Patch, fit_extended
from lensforge.geometry.plan import Plan, make_plan
from lensforge.geometry.refinement import CHORD_MM
from lensforge.geometry.rings import rings_for
from lensforge.geometry.signed_step import signed_step, solid_on_base
from lensforge.geometry.size import mesh_bounds_mm, solid_area_mm2
from lensforge.geometry.solid import Solid, untrimmed_faces
from lensforge.geometry.step import (
    parse_step,
    parse_surfaces,
    require_schema,
    surfaces_bytes,
)
from lensforge.geometry.step_header import StepHeader
from lensforge.geometry.untrimmed_criteria import untrimmed_criteria
from lensforge.geometry.watertight import Closure, check_closed
from lensforge.lens import Lens
from lensforge.records import Extent
from lensforge.surfaces.scaled import scaled


@dataclass(frozen=True)
class _Body:
    """Plan, mesh and solid of the lens, and the errors of the mesh's facets against its faces."""

    plan: Plan[Patch]
    mesh: BodyMesh
    reached: FacetError
    solid: Solid


@dataclass(frozen=True)
class _Proof:
    """Measurements on the files as read back."""

    solid: Solid
    stl: Closure
    threemf: Closure
    form: FormError
    volume_change: float
    mesh_volume_change: float
    mesh_volume_limit: float


def build_part(
    lens: Lens,
    *,
    nodes: int | None = None,
    rings: int | None = None,
    chord_mm: float = CHORD_MM,
    schema: Schema = "AP214",
    runout_deg: float | None = None,
    date: str | None = None,
) -> Part:
    """Make the part: the bytes of STEP, STL and 3MF, and their errors, measured by reading these bytes back.

    ``nodes``: spline nodes across each optical face, by default as many as the form needs.
    ``rings``: equal rings of the mesh; by default as many as the faces' detail needs, their facets split where they
    are more than ``chord_mm`` (mm) from the surface.
    ``runout_deg``: also write ``lens_surfaces.step``, the optical faces untrimmed and extended by this angle (degrees)
    beyond the rim, for the run-out of the tool; those of a mould insert are scaled by 1 + shrinkage, the part is not.
    ``date``: of the files, by default ``manufacture.date``; an AP242 part carries ``manufacture.form_tolerance_um``.
    Missed criteria do not raise. Raises :class:`InputError` for a lens that cannot be built: a wall that is not
    positive, a base too narrow for the cavity, a base's file that does not fit the lens.
    """
    start = time.perf_counter()
    require_schema(schema)
    body = _build(lens, nodes, rings, chord_mm)
    name = lens.spec.name
    signed = signed_step(body.solid, lens.spec, name, schema, date)
    step = signed.content
    untrimmed, surfaces_step = None, None
    if runout_deg is not None:
        untrimmed, surfaces_step = _untrimmed(lens, body.plan, runout_deg, schema, signed.header)
    stl = stl_bytes(body.mesh)
    threemf = threemf_bytes(body.mesh, name)
    proof = _prove(lens, body, step, stl, threemf)
    keep_out = _keep_out(lens, body)
    files = {STEP_FILE: step, STL_FILE: stl, THREEMF_FILE: threemf}
    if surfaces_step is not None:
        files[SURFACES_FILE] = surfaces_step
    return Part(
        inputs={"lens": lens.sha256},
        lens=lens,
        form_error_nm=Extent(max=proof.form.form_max_nm, rms=proof.form.form_rms_nm),
        normal_error_mrad=Extent(max=proof.form.normal_max_mrad, rms=proof.form.normal_rms_mrad),
        volume_mm3=proof.solid.volume_mm3,
        volume_mesh_mm3=proof.stl.volume_mm3,
        mass_g=mass_g(lens.spec, proof.solid.volume_mm3),
        keep_out=keep_out,
        area_mm2=solid_area_mm2(proof.solid),
        area_mesh_mm2=body.mesh.area(),
        bounds_mm=mesh_bounds_mm(body.mesh),
        watertight=proof.stl.watertight,
        genus=proof.stl.genus,
        faces=Faces(count=len(proof.solid.shape.Faces()), names=tuple(sorted(proof.solid.faces))),
        nodes=SplineNodes(inner=body.plan.inner.nodes, outer=body.plan.outer.nodes),
        step_schema=schema,
        form_tolerances=signed.tolerances,
        signature=signed.signature,
        untrimmed_surfaces=untrimmed,
        triangulation=_describe(body),
        files={name: stamp_of(content) for name, content in files.items()},
        seconds=round(time.perf_counter() - start, 3),
        criteria=(*_criteria(proof), *untrimmed_criteria(untrimmed), *keep_out_criteria(lens.spec, keep_out)),
        step=step,
        stl=stl,
        threemf=threemf,
        surfaces_step=surfaces_step,
    )


def _build(lens: Lens, nodes: int | None, rings: int | None, chord_mm: float) -> _Body:
    """Fit the faces, build mesh and solid, and join the base where it comes from a file."""
    base = None if lens.spec.base.file is None else read_custom_base(lens.spec.base.file)
    plan = make_plan(*fit_faces(lens, nodes, nodes), base_with_room(lens))
    mesh = build_mesh(plan, rings_for(plan, chord_mm), chord_mm) if rings is None else build_mesh(plan, rings)
    reached = mesh_error(mesh, plan)
    solid = solid_on_base(plan, base)
    if base is not None:
        mesh = join_mesh(mesh, base, reached.chord_mm)
    return _Body(plan, mesh, reached, solid)


def _keep_out(lens: Lens, body: _Body) -> KeepOutDistance | None:
    """Distance of the body from the keep-out of the spec; None where it has none."""
    path = lens.spec.constraints.keep_out
    if path is None:
        return None
    error_mm = mesh_error_mm(lens.spec.base, body.mesh.rings, body.reached.chord_mm)
    return keep_out_distance(body.mesh, read_keep_out(path), error_mm)


def _untrimmed(
    lens: Lens, plan: Plan[Patch], runout_deg: float, schema: Schema, header: StepHeader
) -> tuple[UntrimmedSurfaces, bytes]:
    """The untrimmed faces as a STEP file of their own, and their form error above the rim as read back."""
    scale = lens.spec.manufacture.scale
    outer, inner = scaled(lens.outer, scale), scaled(lens.inner, scale)
    patches = {
        OUTER: fit_extended(outer, plan.outer.nodes, runout_deg),
        INNER: fit_extended(inner, plan.inner.nodes, runout_deg),
    }
    product = f"{lens.spec.name} surfaces"
    if scale != 1.0:
        product = f"{lens.spec.name} surfaces of the mould, the lens scaled by {scale:.12g}"
    content = surfaces_bytes(untrimmed_faces(patches), product, schema, header=header)
    faces = parse_surfaces(content)
    form = worst([face_error(outer, faces[OUTER]), face_error(inner, faces[INNER])])
    found = UntrimmedSurfaces(
        runout_deg=runout_deg,
        scale=scale,
        form_error_nm=form.form_max_nm,
        normal_error_mrad=form.normal_max_mrad,
    )
    return found, content


def _prove(lens: Lens, body: _Body, step: bytes, stl: bytes, threemf: bytes) -> _Proof:
    """Read the files again and compare them with the surfaces and with each other."""
    solid = parse_step(step)
    closure = check_closed(*parse_stl(stl))
    with ThreadPoolExecutor() as pool:
        errors = pool.map(face_error, (lens.outer, lens.inner), (solid.faces[OUTER], solid.faces[INNER]))
    return _Proof(
        solid=solid,
        stl=closure,
        threemf=check_closed(*parse_3mf(threemf)),
        form=worst(list(errors)),
        volume_change=abs(solid.default_volume_mm3 / body.solid.default_volume_mm3 - 1.0),
        mesh_volume_change=abs(closure.volume_mm3 / solid.volume_mm3 - 1.0),
        mesh_volume_limit=mesh_volume_limit(body.mesh.area(), body.reached.chord_mm, solid.volume_mm3),
    )


def _criteria(proof: _Proof) -> tuple[Criterion, ...]:
    """The criteria that the files must meet before they go to a shop."""
    finer, rings = "raise the number of nodes", "change the number of rings"
    form, faults = proof.form, ", ".join(proof.solid.faults) or "the whole solid"
    wrong_at = f"try another base.diameter_mm, or no base; not valid: {faults}"
    stl, threemf = proof.stl, proof.threemf
    measured = {
        "form_error": form.form_max_nm,
        "normal_error": form.normal_max_mrad,
        "step_valid": float(proof.solid.valid),
        "step_volume_change": proof.volume_change,
        "watertight": float(stl.watertight),
        "watertight_3mf": float(threemf.watertight),
        "genus_difference": float(abs(stl.genus - proof.solid.genus)),
        "mesh_volume_change": proof.mesh_volume_change,
    }
    remedies = {
        "form_error": finer + _at(form.form_at_mm),
        "normal_error": finer + _at(form.normal_at_mm),
        "step_valid": wrong_at,
        "step_volume_change": finer,
        "watertight": rings + _at(stl.fault_mm),
        "watertight_3mf": rings + _at(threemf.fault_mm),
        "genus_difference": rings,
        "mesh_volume_change": "raise the number of rings",
    }
    return part_criteria(measured, proof.mesh_volume_limit, remedies)


def _at(place_mm: Place | None) -> str:
    return "" if place_mm is None else f"; it is at ({', '.join(f'{value:.4g}' for value in place_mm)}) mm"


def _describe(body: _Body) -> Triangulation:
    return Triangulation(
        triangles=len(body.mesh.triangles),
        vertices=len(body.mesh.vertices),
        rings=body.mesh.rings,
        chord_error_um=body.reached.chord_mm * 1e3,
        normal_error_mrad=body.reached.normal_rad * 1e3,
    )
