"""Derivative of the light of a collimator of four faces: the adjoint, creases of the cavity, and what is left out.

The light of a body is a sum over rays, and the adjoint differentiates each as if it kept its faces. Rays that cross a
crease as a face moves add a term: the flux that crosses, times what changes with the crossing. ``light.crease`` has it
for creases of the cavity, which rays meet first, ``light.later_creases`` for others. Differences of the sum over those
rays alone that change their way, over a step so large that many do, tell the size of each cause: what the first event
is that is another one.

    python benchmarks/crease_derivative.py

Two minutes; prints the table of docs/accuracy.md, and the seconds of a gradient step and of the term.
"""

from collections.abc import Callable
from time import perf_counter

import numpy as np

import lensforge as lf
from lensforge.light.crease import crease_gradients
from lensforge.light.later_creases import later_crease_gradients
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import TracedBundle
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.optics.media import Media, Medium
from lensforge.scene.body import Body, Face
from lensforge.scene.exit_rays import Sensitivities
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace

REACH_MM, EVENTS, STEP_MM, SEEDS, RAYS = 16.0, 4, 1e-2, 16, 2**18
SAMPLES, STEP_RAYS, REPEATS = 2**11, 2**17, 5
COMPUTED = "adjoint", "creases of the cavity", "later creases"
CAUSES = "cavity, by differences", "later, by differences", "edge of total reflection", "rim"
SOURCE = build_source(lf.SquareSource(side_mm=1.0), None)
COLLIMATOR = Body(
    (
        Face("cap", PlaneFace(REACH_MM, height_mm=4.0), CAVITY, BODY),
        Face("side", ConeFace(REACH_MM, radius_mm=3.2, slope=-0.05), CAVITY, BODY),
        Face("wall", ConicFace(REACH_MM, parameter_mm=5.0, eccentricity=1.0), BODY, OUTSIDE),
        Face("exit", PlaneFace(REACH_MM, height_mm=9.0), BODY, OUTSIDE),
    )
)


def shares(traced: TracedBundle) -> np.ndarray:
    """Flux of each ray that leaves, times its cosine to the axis: smooth in every ray that leaves."""
    exits = traced.exits
    return exits.flux * exits.directions[:, 2] * exits.left_lens


def adjoint(lens: TracedLens, rays: RayBundle) -> np.ndarray:
    """Gradients by all tables of the sum of the shares, for rays that keep their faces."""
    traced = TracedBundle.of(lens.tables, lens.scene, rays)
    left = 1.0 * traced.exits.left_lens
    along = (left * traced.exits.flux)[:, None] * np.array([0.0, 0.0, 1.0])
    by = Sensitivities(np.zeros_like(along), along)
    return traced.gradients(by, left * traced.exits.directions[:, 2], np.zeros(len(rays)))


def changes(ends: list[TracedBundle]) -> list[float]:
    """Change of the sum over rays that change their way for 1 mm, by each of ``CAUSES``."""
    one, other = (traced.met for traced in ends)
    assert one is not None and other is not None
    apart, rows = one != other, np.arange(len(one))
    event = np.argmax(apart, axis=1)
    first, second = one[rows, event], other[rows, event]
    face, lost = first >> 2 != second >> 2, (first < 0) | (second < 0)
    causes = face & ~lost & (event == 0), face & ~lost & (event > 0), ~face, lost
    gains = (shares(ends[0]) - shares(ends[1])) / (2.0 * STEP_MM)
    return [float(gains[apart.any(axis=1) & cause].sum()) for cause in causes]


def slopes(lens: TracedLens, seed: int) -> np.ndarray:
    """Change of the sum for 1 mm more radius of each face: by the adjoint, by creases, and by each cause."""
    rays, by_cause = SOURCE.sample(RAYS, seed), []
    for face in range(len(lens.tables)):
        ends = []
        for sign in (1.0, -1.0):
            moved = lens.tables.copy()
            moved[face] += sign * STEP_MM
            ends.append(TracedBundle.of(moved, lens.scene, rays))
        by_cause.append(changes(ends))
    scene = lens.tables, lens.scene, SOURCE, shares
    found = adjoint(lens, rays), crease_gradients(*scene, SAMPLES, seed), later_crease_gradients(*scene, seed=seed)
    return np.stack([*(each.sum(axis=(1, 2)) for each in found), *np.transpose(by_cause)])


def cell(values: np.ndarray) -> str:
    """Mean of the samples and its standard error."""
    return f"{values.mean():.4f} ± {values.std(ddof=1) / np.sqrt(SEEDS):.4f}"


def seconds(work: Callable[[], object]) -> float:
    """Least of some repeats."""
    found = []
    for _ in range(REPEATS):
        start = perf_counter()
        work()
        found.append(perf_counter() - start)
    return min(found)


def main() -> None:
    """Print a table in Markdown, and times."""
    lens = TracedLens.of_body(COLLIMATOR, Media(Medium(1.4936)), EVENTS, 8.0)
    found = np.array([slopes(lens, seed) for seed in range(SEEDS)])
    print(f"| face | {' | '.join((*COMPUTED, *CAUSES))} |\n|{8 * '---|'}")
    for face, name in enumerate(lens.scene.names):
        print(f"| {name} | {' | '.join(map(cell, found[:, :, face].T))} |")
    rays = SOURCE.sample(STEP_RAYS, 0)
    step = seconds(lambda: adjoint(lens, rays))
    print(f"{len(rays)} rays, traced and back: {step:.3f} s")
    for term in (crease_gradients, later_crease_gradients):
        print(f"{term.__name__}: {seconds(lambda term=term: term(lens.tables, lens.scene, SOURCE, shares)):.3f} s")


if __name__ == "__main__":
    main()
