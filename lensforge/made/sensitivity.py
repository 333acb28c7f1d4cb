"""The sensitivity study: metrics of the lens as designed, and with each tolerance at its end, one at a time."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.light.evaluation_result import LightMetrics
from lensforge.made.part_study import PartStudy, Recipe, require_feasible_tolerances
from lensforge.made.tolerance_result import ErrorRow, Sensitivity
from lensforge.scene.body import nearest
from lensforge.scene.lens import Lens
from lensforge.scene.perturbations import Deviations
from lensforge.spec.tolerances_section import Factor
from lensforge.surfaces.bicubic_table import evaluate_table
from lensforge.surfaces.srbf import fibonacci_hemisphere

_SHAPE_SEED = 11  # of the form errors: any number
_SAMPLES = 4000


@dataclass(frozen=True)
class SingleError:
    """One tolerance at its end: name, amount, unit, and the deviations that it makes."""

    name: str
    amount: float
    unit: str
    deviations: Deviations


def measure_sensitivity(lens: Lens, *, rays: int, progress: Callable[[int, int], object] | None = None) -> Sensitivity:
    """Trace the lens with each tolerance of its spec at its end, always with the same rays; of lamps, at once in all.

    Changes are from the lens as designed, replicate by replicate: the noise that both have in common cancels, and the
    standard error of a change is that of what is left. ``progress`` is called after each lens with the number of lenses
    traced and of all.
    """
    started, announce = time.perf_counter(), progress or (lambda done, total: None)
    study = PartStudy(Recipe(lens, 1, rays, lens.seed, rays))
    require_feasible_tolerances(lens, study.factors)
    errors = [error for factor in study.factors for error in single_errors(study, factor)]
    designed, count = study.designed.metrics[0], len(study.light.held)
    announce(1, len(errors) + 1)
    rows = []
    for done, error in enumerate(errors, start=2):
        part = study.made([error.deviations] * len(study.lamps))
        found = study.light.measured(study.light.received(part)).metrics[0]
        change: LightMetrics = found.change_from(designed, count)
        rows.append(
            ErrorRow(name=error.name, amount=error.amount, unit=error.unit, metrics=found.metrics(), change=change)
        )
        announce(done, len(errors) + 1)
    return Sensitivity(
        inputs={"lens": lens.sha256},
        nominal=designed.metrics(),
        rows=tuple(rows),
        preset=lens.spec.tolerances.preset,
        rays=count,
        seconds=time.perf_counter() - started,
    )


def single_errors(study: PartStudy, factor: Factor) -> Iterator[SingleError]:
    """A tolerance at its end: to both sides or, in two directions, along each; a form error in one random shape."""
    amount, unit = factor.amount, factor.unit
    if factor.kind == "field":
        yield SingleError(factor.words, amount, unit, {factor.name: _shape(study, factor)})
    elif factor.kind == "one-sided":
        yield SingleError(factor.words, amount, unit, _at(factor, [1.0]))
    elif factor.numbers == 1:
        for sign in (1.0, -1.0):
            yield SingleError(factor.words, sign * amount, unit, _at(factor, [sign]))
    else:
        preposition = "about" if factor.name.endswith("_deg") else "in"
        for axis, numbers in (("x", [1.0, 0.0]), ("y", [0.0, 1.0])):
            yield SingleError(f"{factor.words} {preposition} {axis}", amount, unit, _at(factor, numbers))


def _at(factor: Factor, numbers: list[float]) -> Deviations:
    return {factor.name: factor.amount * factor.to_internal * np.array(numbers)}


def _shape(study: PartStudy, factor: Factor) -> Float[np.ndarray, " k"]:
    """Numbers (mm) of a random shape of which the rms along the normal, over the face, is the amount."""
    numbers = np.random.default_rng([_SHAPE_SEED, *factor.name.encode()]).standard_normal(factor.numbers)
    amount, tables = factor.amount * factor.to_internal, study.maker.errors[factor.name].tables
    if not len(tables):  # too fine for the tables: its slope counts, by the rms of its numbers
        return amount * numbers / float(np.sqrt(np.mean(numbers**2)))
    body, u = study.recipe.lens.body, fibonacci_hemisphere(_SAMPLES)
    face = next(face for face in body.faces if factor.name.startswith(f"{face.name}_"))
    beside = body.bounding(face.before)
    u = u[nearest(beside, u) == beside.index(face)]
    cosine = np.sum(face.surface.normal(u) * u, axis=1)
    error = evaluate_table(study.light.nominal.scene.grid, np.tensordot(numbers, tables, axes=1), u) * cosine
    return amount * numbers / float(np.sqrt(np.mean(error**2)))
