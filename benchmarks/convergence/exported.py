"""The exported shape: nodes of the NURBS faces, rings of the mesh, and rays through that mesh."""

from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Float, Int

from convergence.reference import LIGHT_UNITS, ExactReference
from convergence.study import ConvergenceStudy, Meter, orders_of, reference_level
from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.facets import CHORD_MM
from lensforge.cad.form_error import chart_samples, fit_lens, form_error, worst
from lensforge.cad.mesh import build_mesh, mesh_error, rings_for
from lensforge.cad.patch import DEGREE, Patch, fit_patch
from lensforge.cad.plan import INNER, OUTER, Plan, make_plan
from lensforge.cad.solid import build_solid
from lensforge.cad.step import step_bytes
from lensforge.proof.facet_casting import Grid
from lensforge.proof.part_mesh import PartMesh, part_mesh_of
from lensforge.proof.proof_inputs import screens_of
from lensforge.proof.sequential_cast import send_through
from lensforge.results import Metric
from lensforge.scene.lens import Lens

NODES = (36, 48, 72, 96, 128)
MESH_RINGS, CAST_RINGS = (24, 48, 96, 128), (24, 48, 96)
CURVED, FLAT = "curved facets", "flat facets"
EQUAL, SPLIT = "equal rings", "rings, split to the tolerance"
_SAMPLES = 2048
_FORM_UNITS, _CHORD_UNITS = {"form": "nm", "normal": "mrad"}, {"chord": "um"}

Patches = dict[str, Patch]


def nurbs_study(
    lens: Lens, settings: Sequence[int] = NODES, *, cad: bool = True
) -> tuple[ConvergenceStudy, Plan[Patch]]:
    """Form and normal error of the spline faces over the hemisphere and on its rim, and the size of the STEP file.

    With ``cad`` the solid of each level is built and written, which loads the CAD kernel. Also returns the plan of the
    body with the export's number of nodes.
    """
    chosen: Patches = dict(zip(("inner", "outer"), (side.faces[0].shape for side in fit_lens(lens)), strict=True))
    chart = chart_samples(_SAMPLES)
    levels = []
    for nodes in sorted({*settings, *(patch.nodes for patch in chosen.values())}):
        with Meter() as meter:
            patches = {name: fit_patch(getattr(lens, name), nodes) for name in chosen}
        pairs = [(getattr(lens, name), patch) for name, patch in patches.items()]
        error = worst([form_error(face, patch.points(chart), patch.normals(chart)) for face, patch in pairs])
        errors = {
            "form": Metric(value=error.form_max_nm, unit="nm"),
            "normal": Metric(value=error.normal_max_mrad, unit="mrad"),
        }
        users = tuple(f"the export, {name}" for name, patch in chosen.items() if patch.nodes == nodes)
        other = {"step_kb": _step_kb(patches, lens)} if cad else {}
        levels.append(meter.level(nodes, f"spline of degree {DEGREE}", errors, users, **other))
    orders = {f"spline of degree {DEGREE}": orders_of(levels, ("form", "normal"))}
    levels.append(reference_level("exact sum", _FORM_UNITS))
    study = ConvergenceStudy(
        name="nurbs",
        title="Nodes of the exported faces",
        knob="export --nodes",
        reference=f"the exact sum: {len(chart)} points of each surface, a fifth of them on the rim",
        plotted=("form", "normal"),
        against="setting",
        levels=tuple(levels),
        order=orders,
    )
    return study, make_plan(chosen["inner"], chosen["outer"], base_with_room(lens))


def _step_kb(patches: Patches, lens: Lens) -> float:
    """Size (kB) of the whole part's STEP file."""
    solid = build_solid(make_plan(patches["inner"], patches["outer"], base_with_room(lens)))
    return len(step_bytes(solid, lens.spec.name)) / 1e3


def mesh_study(plan: Plan[Patch], settings: Sequence[int] = MESH_RINGS) -> ConvergenceStudy:
    """Largest distance between the facets of the optical faces and the spline faces."""
    levels = []
    for rings, chord_mm in [*((rings, None) for rings in settings), (rings_for(plan, CHORD_MM), CHORD_MM)]:
        with Meter() as meter:
            mesh = build_mesh(plan, rings, chord_mm)
        triangles = len(mesh.part(OUTER)) + len(mesh.part(INNER))
        errors = {"chord": Metric(value=1e3 * mesh_error(mesh, plan), unit="um")}
        series, users = (EQUAL, ()) if chord_mm is None else (SPLIT, ("the export",))
        levels.append(meter.level(rings, series, errors, users, triangles=triangles))
    orders = {EQUAL: orders_of([level for level in levels if level.series == EQUAL], ("chord",))}
    levels.append(reference_level("spline faces", _CHORD_UNITS))
    return ConvergenceStudy(
        name="mesh",
        title="Rings of the mesh",
        knob="export --rings",
        reference="the spline faces",
        plotted=("chord",),
        against="setting",
        levels=tuple(levels),
        order=orders,
    )


class FlatPart(PartMesh):
    """A part with flat facets, one normal each."""

    def curved(
        self, triangles: Int[np.ndarray, " n"], barycentric: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Points on the facets, and the facets' normals."""
        points = np.einsum("nk,nki->ni", barycentric, self.mesh.triangles[triangles])
        return points, np.asarray(self.mesh.face_normals)[triangles]


def casting_study(
    reference: ExactReference, plan: Plan[Patch], settings: Sequence[int] = CAST_RINGS
) -> ConvergenceStudy:
    """Rays through meshes of several sizes onto the first receiver, with curved facets as in ``verify`` and flat ones.

    The last mesh is that of the export, with facets split to its tolerance; the orders are those of the others, with
    equal rings. The reference is the exact surfaces; seconds are those of the cast.
    """
    lens = reference.lens
    screen = screens_of(lens.spec, lens.spec.optimise.pixels)[0]
    levels = []
    for rings, chord_mm in [*((rings, None) for rings in settings), (rings_for(plan, CHORD_MM), CHORD_MM)]:
        body = build_mesh(plan, rings, chord_mm)
        part = part_mesh_of(trimesh.Trimesh(body.vertices, body.triangles, process=False))
        grid = Grid(part.mesh)
        for series, kind in ((CURVED, PartMesh), (FLAT, FlatPart)):
            seen = kind(part.mesh, part.faces, part.corners, part.fit)
            with Meter() as meter:
                landed = send_through(seen, grid, reference.rays, lens.media).landed(screen)
            lost = np.isnan(landed.landings[:, 0])
            errors = reference.light_errors(
                np.where(lost[:, None], 0.0, landed.landings), np.where(lost, 0.0, landed.flux)
            )
            users = ("verify, on the export's mesh",) if chord_mm is not None and series == CURVED else ()
            levels.append(meter.level(rings, series, errors, users, triangles=len(body.triangles)))
    orders = {
        series: orders_of(
            [level for level in levels[: 2 * len(settings)] if level.series == series],
            ("hit_99_percent", "irradiance_nmse"),
        )
        for series in (CURVED, FLAT)
    }
    levels.append(reference.level("exact surfaces", LIGHT_UNITS))
    return ConvergenceStudy(
        name="casting",
        title="Rays through the mesh",
        knob="export --rings",
        reference=f"the exact surfaces: {len(reference.rays)} rays",
        plotted=("hit_99_percent", "irradiance_nmse"),
        against="setting",
        levels=tuple(levels),
        order=orders,
    )
