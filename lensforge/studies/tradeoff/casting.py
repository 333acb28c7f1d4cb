"""The mesh as verification casts rays through it: where they land, with curved facets and with flat ones."""

from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Float, Int

from lensforge.geometry.grading import MeshTolerance, rings_for
from lensforge.geometry.mesh import build_mesh
from lensforge.geometry.plan import Plan
from lensforge.studies.tradeoff.ladder import Ladder, Meter, Rung, orders_of
from lensforge.studies.tradeoff.truth import LIGHT_UNITS, Truth
from lensforge.verification.casting import Grid
from lensforge.verification.part import Part, part_of
from lensforge.verification.passage import send_through

RINGS = (24, 48, 96)
CURVED, FLAT = "curved facets", "flat facets"


class FlatPart(Part):
    """A part whose facets are taken for what they are: flat, with one normal each."""

    def curved(
        self, triangles: Int[np.ndarray, " n"], barycentric: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """The points on the facets, and the facets' normals."""
        points = np.einsum("nk,nki->ni", barycentric, self.mesh.triangles[triangles])
        return points, np.asarray(self.mesh.face_normals)[triangles]


def casting_ladder(truth: Truth, plan: Plan, settings: Sequence[int] = RINGS) -> Ladder:
    """Rays through meshes of several sizes against the exact surfaces; seconds are those of the cast."""
    used = rings_for(plan, MeshTolerance())
    lens = truth.lens
    rungs = []
    for rings in sorted({*settings, used}):
        body = build_mesh(plan, rings)
        part = part_of(trimesh.Trimesh(body.vertices, body.triangles, process=False))
        grid = Grid(part.mesh)
        for series, kind in ((CURVED, Part), (FLAT, FlatPart)):
            seen = kind(part.mesh, part.faces, part.corners, part.fit)
            with Meter() as meter:
                passage = send_through(seen, grid, truth.rays, lens.refractive_index, lens.spec.target.distance_mm)
            lost = np.isnan(passage.landings[:, 0])
            errors = truth.light_errors(
                np.where(lost[:, None], 0.0, passage.landings), np.where(lost, 0.0, passage.flux)
            )
            users = ("verify, on the export's mesh",) if rings == used and series == CURVED else ()
            other = {"triangles": len(body.triangles)}
            rungs.append(
                Rung(
                    setting=rings,
                    series=series,
                    seconds=meter.seconds,
                    peak_mb=meter.peak_mb,
                    errors=errors,
                    presets=users,
                    other=other,
                )
            )
    orders = {
        series: orders_of([rung for rung in rungs if rung.series == series], ("hit_99_percent", "irradiance_nmse"))
        for series in (CURVED, FLAT)
    }
    rungs.append(truth.reference_rung("exact surfaces", LIGHT_UNITS))
    return Ladder(
        name="casting",
        title="Rays through the mesh",
        knob="export --rings",
        reference=f"the exact surfaces: {len(truth.rays)} rays",
        plotted=("hit_99_percent", "irradiance_nmse"),
        against="setting",
        rows=tuple(rungs),
        order=orders,
    )
