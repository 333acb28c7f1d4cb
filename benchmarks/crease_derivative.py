"""What the adjoint leaves out where rays change the face that they meet, on the collimator of four faces.

The light of a body is a sum over rays, and the adjoint differentiates each as if it kept its faces. Rays that cross a
crease as a face moves add a term: the flux that crosses, times what changes with the crossing. It is the difference of
the adjoint to differences of the sum itself, of the same rays, over a step so large that many cross.

    python benchmarks/crease_derivative.py

One minute; prints the table of docs/accuracy.md.
"""

import numpy as np

import lensforge as lf
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import TracedBundle
from lensforge.optics.media import BODY, CAVITY, OUTSIDE, Media, Medium
from lensforge.scene.body import Body, Face
from lensforge.scene.exit_rays import ExitRays, Sensitivities
from lensforge.sources.build_source import build_source
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace

REACH_MM, EVENTS, STEP_MM, SEEDS, RAYS = 16.0, 4, 2e-3, 8, 2**18
COLLIMATOR = Body(
    (
        Face("cap", PlaneFace(REACH_MM, height_mm=4.0), CAVITY, BODY),
        Face("side", ConeFace(REACH_MM, radius_mm=3.2, slope=-0.05), CAVITY, BODY),
        Face("wall", ConicFace(REACH_MM, parameter_mm=5.0, eccentricity=1.0), BODY, OUTSIDE),
        Face("exit", PlaneFace(REACH_MM, height_mm=9.0), BODY, OUTSIDE),
    )
)


def merit(exits: ExitRays, emitted_w: float) -> float:
    """Mean over the emitted flux of what leaves times the cosine to the axis: smooth in every ray that leaves."""
    return float((exits.flux * exits.directions[:, 2])[exits.left_lens].sum() / emitted_w)


def slopes(lens: TracedLens, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Change of the merit for 1 mm more radius of each face: by the adjoint, and by differences of the sum."""
    rays = build_source(lf.SquareSource(side_mm=1.0), None).sample(RAYS, seed)
    total, traced = rays.flux.sum(), TracedBundle.of(lens.tables, lens.scene, rays)
    left = traced.exits.left_lens / total
    along = (left * traced.exits.flux)[:, None] * np.array([0.0, 0.0, 1.0])
    by = Sensitivities(np.zeros((RAYS, 3)), along)
    adjoint = traced.gradients(by, left * traced.exits.directions[:, 2], np.zeros(RAYS)).sum(axis=(1, 2))
    differences = np.empty(len(lens.tables))
    for face in range(len(lens.tables)):
        ends = []
        for sign in (1.0, -1.0):
            moved = lens.tables.copy()
            moved[face] += sign * STEP_MM
            ends.append(merit(TracedBundle.of(moved, lens.scene, rays).exits, total))
        differences[face] = (ends[0] - ends[1]) / (2.0 * STEP_MM)
    return adjoint, differences


def main() -> None:
    """Print a table in Markdown."""
    lens = TracedLens.of_body(COLLIMATOR, Media(Medium(1.4936)), EVENTS, 8.0)
    found = np.array([slopes(lens, seed) for seed in range(SEEDS)])
    mean, error = found.mean(axis=0), found.std(axis=0, ddof=1) / np.sqrt(SEEDS)
    print("| face | adjoint (1/mm) | with the rays that change faces (1/mm) | left out |\n|---|---|---|---|")
    for face, name in enumerate(lens.scene.names):
        cells = [f"{mean[k, face]:.5f} ± {error[k, face]:.5f}" for k in (0, 1)]
        apart = (found[:, 1] - found[:, 0])[:, face]
        left_out = f"{apart.mean():.5f} ± {apart.std(ddof=1) / np.sqrt(SEEDS):.5f}"
        print(f"| {name} | {cells[0]} | {cells[1]} | {left_out} |")


if __name__ == "__main__":
    main()
