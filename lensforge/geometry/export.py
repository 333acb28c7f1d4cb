"""The geometry stage: from a lens record to STEP, STL and 3MF, proven by reading all of them back."""

import hashlib
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lensforge.files import write_json
from lensforge.gates import Gate
from lensforge.geometry.form import FormError, Place, face_error, fit_to_form, worst
from lensforge.geometry.grading import MeshTolerance, mesh_error, rings_for
from lensforge.geometry.mesh import INNER, OUTER, BodyMesh, build_mesh
from lensforge.geometry.mesh_union import join_mesh
from lensforge.geometry.patch import fit_extended
from lensforge.geometry.plan import Plan, make_plan
from lensforge.geometry.solid import Solid, build_solid, untrimmed_faces
from lensforge.geometry.step import Schema, read_step, read_surfaces, write_step, write_surfaces
from lensforge.geometry.step_base import join_base, read_base
from lensforge.geometry.stl import read_stl, write_stl
from lensforge.geometry.threemf import read_3mf, write_3mf
from lensforge.geometry.watertight import Closure, check_closed
from lensforge.lens import Lens

STEP_FILE, STL_FILE, THREEMF_FILE, JSON_FILE = "lens.step", "lens.stl", "lens.3mf", "export.json"
SURFACES_FILE = "lens_surfaces.step"

_FORM_LIMIT_NM, _NORMAL_LIMIT_MRAD = 1.0, 0.02
_ROUND_TRIP_LIMIT = 1e-9


@dataclass(frozen=True)
class _Proof:
    """What was found on the files as read back."""

    solid: Solid
    stl: Closure
    threemf: Closure
    form: FormError
    volume_change: float
    mesh_volume_change: float
    mesh_volume_limit: float


def export_lens(
    lens: Lens,
    directory: Path,
    *,
    nodes: int | None = None,
    rings: int | None = None,
    tolerance: MeshTolerance | None = None,
    schema: Schema = "AP214",
    runout_deg: float | None = None,
) -> dict[str, Any]:
    """Write ``lens.step``, ``lens.stl``, ``lens.3mf`` and ``export.json`` into ``directory``; return the last.

    ``nodes``: spline nodes across each optical face, by default as many as the form needs.
    ``rings``: rings of the mesh, by default as many as ``tolerance`` needs.
    ``runout_deg``: also write ``lens_surfaces.step``, the optical faces untrimmed and going on by this angle (degrees)
    beyond the rim, for the run-out of the tool.
    Failed gates do not raise. Raises :class:`InputError` for a lens that is no body: a wall that is not positive,
    a base too narrow for the cavity, a base's file that does not go under the lens.
    """
    start = time.perf_counter()
    directory = Path(directory)
    base = None if lens.spec.base.file is None else read_base(lens.spec.base.file)
    with ThreadPoolExecutor() as pool:
        inner, outer = pool.map(fit_to_form, (lens.inner, lens.outer), (nodes, nodes))
    plan = make_plan(inner, outer, lens.spec.base)
    mesh = build_mesh(plan, rings_for(plan, tolerance or MeshTolerance()) if rings is None else rings)
    reached = mesh_error(plan, mesh.rings)
    solid = build_solid(plan)
    if base is not None:
        mesh, solid = join_mesh(mesh, base.solid, reached.chord_mm), join_base(solid, base)
    surfaces = None if runout_deg is None else _write_extended(lens, plan, directory, runout_deg, schema)
    write_step(solid, directory / STEP_FILE, lens.spec.name, schema)
    write_stl(mesh, directory / STL_FILE)
    write_3mf(mesh, directory / THREEMF_FILE, lens.spec.name)
    proof = _prove(lens, solid, mesh, reached, directory)
    files = (STEP_FILE, STL_FILE, THREEMF_FILE, *([SURFACES_FILE] if surfaces else []))
    content = {
        "form_error_nm": {"max": proof.form.form_max_nm, "rms": proof.form.form_rms_nm},
        "normal_error_mrad": {"max": proof.form.normal_max_mrad, "rms": proof.form.normal_rms_mrad},
        "volume_mm3": proof.solid.volume_mm3,
        "volume_mesh_mm3": proof.stl.volume_mm3,
        "watertight": proof.stl.watertight,
        "genus": proof.stl.genus,
        "faces": {"count": len(proof.solid.shape.Faces()), "names": sorted(proof.solid.faces)},
        "nodes": {"inner": plan.inner.nodes, "outer": plan.outer.nodes},
        "step_schema": schema,
        "untrimmed_surfaces": surfaces,
        "mesh": _describe(mesh, reached),
        "files": {name: _fingerprint(directory / name) for name in files},
        "seconds": round(time.perf_counter() - start, 3),
        "gates": [gate.to_json() for gate in _gates(proof)],
    }
    write_json(directory / JSON_FILE, content)
    return content


def _write_extended(lens: Lens, plan: Plan, directory: Path, runout_deg: float, schema: Schema) -> dict[str, Any]:
    """The untrimmed faces in a file of their own, and their form error above the rim as read back."""
    patches = {
        OUTER: fit_extended(lens.outer, plan.outer.nodes, runout_deg),
        INNER: fit_extended(lens.inner, plan.inner.nodes, runout_deg),
    }
    write_surfaces(untrimmed_faces(patches), directory / SURFACES_FILE, f"{lens.spec.name} surfaces", schema)
    faces = read_surfaces(directory / SURFACES_FILE)
    form = worst([face_error(lens.outer, faces[OUTER]), face_error(lens.inner, faces[INNER])])
    return {"runout_deg": runout_deg, "form_error_nm": form.form_max_nm, "normal_error_mrad": form.normal_max_mrad}


def _prove(lens: Lens, built: Solid, mesh: BodyMesh, reached: MeshTolerance, directory: Path) -> _Proof:
    """Read the files again and compare them with the surfaces and with each other."""
    solid = read_step(directory / STEP_FILE)
    stl = check_closed(*read_stl(directory / STL_FILE))
    with ThreadPoolExecutor() as pool:
        errors = pool.map(face_error, (lens.outer, lens.inner), (solid.faces[OUTER], solid.faces[INNER]))
    return _Proof(
        solid=solid,
        stl=stl,
        threemf=check_closed(*read_3mf(directory / THREEMF_FILE)),
        form=worst(list(errors)),
        volume_change=abs(solid.volume_mm3 / built.volume_mm3 - 1.0),
        mesh_volume_change=abs(stl.volume_mm3 / solid.volume_mm3 - 1.0),
        mesh_volume_limit=mesh.area() * reached.chord_mm / solid.volume_mm3,
    )


def _gates(proof: _Proof) -> list[Gate]:
    """Everything that must hold before the files may go to a shop."""
    finer, rings = "raise the number of nodes", "change the number of rings"
    form, faults = proof.form, ", ".join(proof.solid.faults) or "the whole"
    wrong_at = f"try another base.diameter_mm, or no base; it is {faults} that is not valid"
    stl, threemf = proof.stl, proof.threemf
    return [
        Gate("form_error", form.form_max_nm, "<=", _FORM_LIMIT_NM, "nm", finer + _at(form.form_at_mm)),
        Gate("normal_error", form.normal_max_mrad, "<=", _NORMAL_LIMIT_MRAD, "mrad", finer + _at(form.normal_at_mm)),
        Gate("step_valid", float(proof.solid.valid), ">=", 1.0, "", wrong_at),
        Gate("step_volume_change", proof.volume_change, "<=", _ROUND_TRIP_LIMIT, "", finer),
        Gate("watertight", float(stl.watertight), ">=", 1.0, "", rings + _at(stl.fault_mm)),
        Gate("watertight_3mf", float(threemf.watertight), ">=", 1.0, "", rings + _at(threemf.fault_mm)),
        Gate("genus_difference", abs(stl.genus - proof.solid.genus), "<=", 0.0, "", rings),
        Gate(
            "mesh_volume_change",
            proof.mesh_volume_change,
            "<=",
            proof.mesh_volume_limit,
            "",
            "raise the number of rings",
        ),
    ]


def _at(place_mm: Place | None) -> str:
    return "" if place_mm is None else f"; it is at ({', '.join(f'{value:.4g}' for value in place_mm)}) mm"


def _describe(mesh: BodyMesh, reached: MeshTolerance) -> dict[str, Any]:
    return {
        "triangles": len(mesh.triangles),
        "vertices": len(mesh.vertices),
        "rings": mesh.rings,
        "chord_error_um": reached.chord_mm * 1e3,
        "normal_error_mrad": reached.normal_rad * 1e3,
    }


def _fingerprint(path: Path) -> dict[str, Any]:
    content = path.read_bytes()
    return {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
