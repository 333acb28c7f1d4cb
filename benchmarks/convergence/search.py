"""The search itself: what ever more functions and steps gain, what they cost, and what they ask of the shop.

One search with automatic levels is looked at where each of its stages ends, so that functions and steps grow along it
as they do in a design.
"""

from dataclasses import dataclass

from convergence.study import ConvergenceStudy, RefinementLevel, Setting, reference_level
from lensforge.cad.form_error import FormError, chart_samples, fit_lens, form_error, worst
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.simulation import TracedLens
from lensforge.results import Metric
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Progress
from lensforge.search.optimiser import search
from lensforge.shop.face_check import SAMPLE_NODES
from lensforge.shop.face_samples import AirSide, OpticalFace, sample_face
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Accuracy, Spec
from lensforge.spec.accuracy import PRESETS

RAYS = 2**20
_UNITS = {"nmse": "", "loss": "", "form": "nm"}


@dataclass(frozen=True)
class _Stage:
    """The lens at the end of a stage of the search."""

    functions: int
    steps: int
    seconds: float
    lens: Lens


def search_study(spec: Spec, source: Source, accuracy: Accuracy = "standard", rays: int = RAYS) -> ConvergenceStudy:
    """NMSE and lost light after each stage, with time, smallest concave radii, and the form error of the export.

    Of all stages, of those too that the search left out again.
    """
    stages: list[_Stage] = []

    def look(step: Progress) -> None:
        if step.steps_done == step.steps_total:
            stages.append(_Stage(step.functions, step.steps_done, step.seconds, step.lens()))

    search(spec.with_automatic_levels(), source, accuracy=accuracy, progress=look)
    levels = [_level(stage, source, accuracy, rays) for stage in stages]
    return ConvergenceStudy(
        name="search",
        title="Functions and steps of the search",
        knob="lens.levels, optimise.seconds",
        reference=f"the target, {rays} rays; light that no lens loses",
        plotted=("nmse", "loss"),
        against="seconds",
        levels=(*levels, reference_level("target", _UNITS)),
    )


def _level(stage: _Stage, source: Source, accuracy: Accuracy, rays: int) -> RefinementLevel:
    traced = TracedLens.of(stage.lens, PRESETS[accuracy].evaluate_nodes_per_sigma)
    light = evaluate_traced(traced, stage.lens.spec, source, rays, stage.lens.seed)
    error, radii = _export(stage.lens)
    lost = Metric(value=1.0 - light.efficiency.value, standard_error=light.efficiency.standard_error)
    form = Metric(value=error.form_max_nm, unit="nm")
    other: dict[str, Setting] = {"steps": stage.steps, **radii}
    if light.uniformity is not None:
        other["uniformity"] = light.uniformity.value
    return RefinementLevel(
        setting=stage.functions,
        series="automatic levels",
        seconds=stage.seconds,
        peak_mb=None,
        errors={"nmse": light.nmse, "loss": lost, "form": form},
        other=other,
    )


def _export(lens: Lens) -> tuple[FormError, dict[str, float]]:
    """Form error of the faces as they would be exported, and the smallest concave radius (mm) of each."""
    inner, outer = (side.faces[0].shape for side in fit_lens(lens))
    faces = {"inner": OpticalFace(inner, AirSide.INSIDE), "outer": OpticalFace(outer, AirSide.OUTSIDE)}
    lowest = {name: sample_face(face, SAMPLE_NODES).lowest_curvature() for name, face in faces.items()}
    radii = {f"{name}_concave_mm": -1.0 / curvature for name, curvature in lowest.items() if curvature < 0.0}
    chart, both = chart_samples(), ((lens.inner, inner), (lens.outer, outer))
    return worst([form_error(face, patch.points(chart), patch.normals(chart)) for face, patch in both]), radii
