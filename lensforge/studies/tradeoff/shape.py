"""Shape: nodes of the exported NURBS faces against the exact sum, and rings of the mesh against the faces."""

from collections.abc import Sequence

from lensforge.geometry.form import chart_samples, fit_to_form, form_error, worst
from lensforge.geometry.grading import MeshTolerance, mesh_error, rings_for
from lensforge.geometry.patch import Patch, fit_patch
from lensforge.geometry.plan import Plan, make_plan
from lensforge.geometry.rings import dome_mesh
from lensforge.geometry.solid import build_solid
from lensforge.geometry.step import step_bytes
from lensforge.lens import Lens
from lensforge.records import Metric
from lensforge.studies.tradeoff.ladder import Ladder, Meter, Rung, exactly, orders_of

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
        errors = {
            "form": Metric(value=error.form_max_nm, unit="nm"),
            "normal": Metric(value=error.normal_max_mrad, unit="mrad"),
        }
        users = tuple(f"the export, {name}" for name, patch in chosen.items() if patch.nodes == nodes)
        other = {"step_kb": _step_kb(patches, lens)} if cad else {}
        rungs.append(
            Rung(
                setting=nodes,
                series="quintic spline",
                seconds=meter.seconds,
                peak_mb=meter.peak_mb,
                errors=errors,
                presets=users,
                other=other,
            )
        )
    orders = {"quintic spline": orders_of(rungs, ("form", "normal"))}
    nothing = exactly({"form": "nm", "normal": "mrad"})
    rungs.append(Rung(setting=0, series="exact sum", seconds=None, peak_mb=None, errors=nothing, reference=True))
    ladder = Ladder(
        name="nurbs",
        title="Nodes of the exported faces",
        knob="export --nodes",
        reference=f"the exact sum: {len(chart)} points of each surface, a fifth of them on the rim",
        plotted=("form", "normal"),
        against="setting",
        rows=tuple(rungs),
        order=orders,
    )
    return ladder, make_plan(chosen["inner"], chosen["outer"], lens.spec.base)


def _step_kb(patches: Patches, lens: Lens) -> float:
    """Size of the whole part's STEP file."""
    solid = build_solid(make_plan(patches["inner"], patches["outer"], lens.spec.base))
    return len(step_bytes(solid, lens.spec.name)) / 1e3


def mesh_ladder(plan: Plan, settings: Sequence[int] = RINGS) -> Ladder:
    """Distance and angle between the facets of the optical faces and the faces themselves, above their centres."""
    used = rings_for(plan, MeshTolerance())
    rungs = []
    for rings in sorted({*settings, used}):
        with Meter() as meter:
            triangles = sum(len(dome_mesh(patch, rings)[1]) for patch in (plan.inner, plan.outer))
        reached = mesh_error(plan, rings)
        errors = {
            "chord": Metric(value=1e3 * reached.chord_mm, unit="um"),
            "normal": Metric(value=1e3 * reached.normal_rad, unit="mrad"),
        }
        users = ("the export",) if rings == used else ()
        rungs.append(
            Rung(
                setting=rings,
                series="mesh",
                seconds=meter.seconds,
                peak_mb=meter.peak_mb,
                errors=errors,
                presets=users,
                other={"triangles": triangles},
            )
        )
    orders = {"mesh": orders_of(rungs, ("chord", "normal"))}
    nothing = exactly({"chord": "um", "normal": "mrad"})
    rungs.append(Rung(setting=0, series="spline faces", seconds=None, peak_mb=None, errors=nothing, reference=True))
    return Ladder(
        name="mesh",
        title="Rings of the mesh",
        knob="export --rings",
        reference="the spline faces",
        plotted=("chord", "normal"),
        against="setting",
        rows=tuple(rungs),
        order=orders,
    )
