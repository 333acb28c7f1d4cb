"""Shape: nodes of the exported NURBS faces against the exact sum, and rings of the mesh against the faces."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from lensforge.geometry.form import chart_samples, fit_to_form, form_error, worst
from lensforge.geometry.grading import MeshTolerance, mesh_error, rings_for
from lensforge.geometry.patch import Patch, fit_patch
from lensforge.geometry.plan import Plan, make_plan
from lensforge.geometry.rings import dome_mesh
from lensforge.geometry.solid import build_solid
from lensforge.geometry.step import write_step
from lensforge.lens import Lens
from lensforge.studies.tradeoff.ladder import Estimate, Ladder, Meter, Rung, orders_of

NODES = (36, 48, 72, 96, 128)
RINGS = (24, 48, 96, 128)
_SAMPLES = 2048

Patches = dict[str, Patch]


def nurbs_ladder(lens: Lens, settings: Sequence[int] = NODES, *, cad: bool = True) -> tuple[Ladder, Plan]:
    """Form and normal error of the spline faces over the hemisphere and on its rim, and the size of the STEP file.

    With ``cad`` the solid of each rung is built and written: that loads the CAD kernel. Also returns the plan of the
    body with as many nodes as the export takes.
    """
    chosen: Patches = {name: fit_to_form(getattr(lens, name)) for name in ("inner", "outer")}
    chart = chart_samples(_SAMPLES)
    rungs = []
    for nodes in sorted({*settings, *(patch.nodes for patch in chosen.values())}):
        with Meter() as meter:
            patches = {name: fit_patch(getattr(lens, name), nodes) for name in chosen}
        error = worst(
            [form_error(getattr(lens, name), p.points(chart), p.normals(chart)) for name, p in patches.items()]
        )
        errors = {"form": Estimate(error.form_max_nm), "normal": Estimate(error.normal_max_mrad)}
        users = tuple(f"the export, {name}" for name, patch in chosen.items() if patch.nodes == nodes)
        other = {"step_kb": _step_kb(patches, lens)} if cad else {}
        rungs.append(Rung(nodes, "quintic spline", meter.seconds, meter.peak_mb, errors, users, other))
    orders = {"quintic spline": orders_of(rungs, ("form", "normal"))}
    nothing = {"form": Estimate(0.0), "normal": Estimate(0.0)}
    rungs.append(Rung(0, "exact sum", None, None, nothing, reference=True))
    ladder = Ladder(
        "nurbs",
        "Nodes of the exported faces",
        "export --nodes",
        f"the exact sum: {len(chart)} points of each surface, a fifth of them on the rim",
        {"form": "nm", "normal": "mrad"},
        ("form", "normal"),
        "setting",
        tuple(rungs),
        orders,
    )
    return ladder, make_plan(chosen["inner"], chosen["outer"], lens.spec.base)


def _step_kb(patches: Patches, lens: Lens) -> float:
    """Size of the whole part's STEP file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lens.step"
        write_step(build_solid(make_plan(patches["inner"], patches["outer"], lens.spec.base)), path, lens.spec.name)
        return path.stat().st_size / 1e3


def mesh_ladder(plan: Plan, settings: Sequence[int] = RINGS) -> Ladder:
    """Distance and angle between the facets of the optical faces and the faces themselves, above their centres."""
    used = rings_for(plan, MeshTolerance())
    rungs = []
    for rings in sorted({*settings, used}):
        with Meter() as meter:
            triangles = sum(len(dome_mesh(patch, rings)[1]) for patch in (plan.inner, plan.outer))
        reached = mesh_error(plan, rings)
        errors = {"chord": Estimate(1e3 * reached.chord_mm), "normal": Estimate(1e3 * reached.normal_rad)}
        users = ("the export",) if rings == used else ()
        rungs.append(Rung(rings, "mesh", meter.seconds, meter.peak_mb, errors, users, {"triangles": triangles}))
    orders = {"mesh": orders_of(rungs, ("chord", "normal"))}
    nothing = {"chord": Estimate(0.0), "normal": Estimate(0.0)}
    rungs.append(Rung(0, "spline faces", None, None, nothing, reference=True))
    return Ladder(
        "mesh",
        "Rings of the mesh",
        "export --rings",
        "the spline faces",
        {"chord": "um", "normal": "mrad"},
        ("chord", "normal"),
        "setting",
        tuple(rungs),
        orders,
    )
