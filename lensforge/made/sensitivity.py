"""The sensitivity study: metrics of the lens as designed, and with each tolerance at its end, one at a time."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from jaxtyping import Float

from lensforge.light.evaluation_result import LightMetrics
from lensforge.made.board_light import LensOnBoard
from lensforge.made.part_study import LedStudy, PartStudy, Recipe
from lensforge.made.tolerance_result import ErrorRow, Sensitivity
from lensforge.scene.body import nearest
from lensforge.scene.lens import Lens
from lensforge.scene.perturbations import Deviations
from lensforge.search.room_for_parts import require_feasible_tolerances
from lensforge.spec.tolerances_section import Factor
from lensforge.surfaces.bicubic_table import evaluate_table

_SHAPE_SEED = 11  # of the form errors: any number
_SAMPLES = 4000


@dataclass(frozen=True)
class SingleError:
    """One tolerance at its end: name, amount, unit, and the deviations that it makes of the lens of each lamp."""

    name: str
    amount: float
    unit: str
    deviations: tuple[Deviations, ...]


def measure_sensitivity(lens: Lens, *, rays: int, progress: Callable[[int, int], object] | None = None) -> Sensitivity:
    """Trace the lens with each tolerance of its spec at its end, always with the same rays, and in all lamps at once.

    Changes are from the lens as designed, replicate by replicate: common noise cancels, and the standard error of a
    change is that of the remainder. ``progress`` is called after each lens with the number of lenses traced and of all.
    """
    announce = progress or (lambda done, total: None)
    steps = count(1)
    study = PartStudy(Recipe(lens, 1, rays, lens.seed, rays))
    require_feasible_tolerances(lens, study.factors)
    errors = [error for factor in study.factors for error in single_errors(study, factor)]
    total = (len(errors) + 1) * len(study.leds)
    return Sensitivity.joined({led.led: _with(led, errors, lambda: announce(next(steps), total)) for led in study.leds})


def _with(led: LedStudy, errors: Sequence[SingleError], announce: Callable[[], object]) -> Sensitivity:
    """Changes of the light of one LED by each of ``errors``; ``announce``: called after each lens."""
    started = time.perf_counter()
    lens = led.study.recipe.lens
    rows = list[ErrorRow]()
    designed = led.designed.metrics[0]
    rays = len(led.light.held)
    announce()
    for error in errors:
        part = led.light.measured(led.light.received(led.made(error.deviations)))
        change: LightMetrics = part.metrics[0].change_from(designed)
        stated = {"name": error.name, "amount": error.amount, "unit": error.unit, "metrics": part.metrics[0].metrics()}
        rows.append(ErrorRow(**stated, change=change, limits=tuple(led.limit_changes(part))))
        announce()
    return Sensitivity(
        inputs={"lens": lens.sha256},
        nominal=designed.metrics(),
        rows=tuple(rows),
        preset=lens.spec.tolerances.preset,
        rays=rays,
        seconds=time.perf_counter() - started,
    )


def single_errors(study: PartStudy, factor: Factor) -> Iterator[SingleError]:
    """A tolerance at its end: to both sides or, in two directions, along each; a form error in one random shape."""
    amount = factor.amount
    unit = factor.unit
    lamps = len(study.lamps)
    if factor.kind == "field":
        shapes = {number: {factor.name: _shape(kind, factor)} for kind in study.kinds for number in kind.numbers}
        yield SingleError(factor.phrase, amount, unit, tuple(shapes[number] for number in range(lamps)))
        return
    ends = [(factor.phrase, amount, [1.0])]
    if factor.kind != "one-sided" and factor.numbers == 1:
        ends.append((factor.phrase, -amount, [-1.0]))
    elif factor.numbers > 1:
        preposition = "about" if factor.name.endswith("_deg") else "in"
        axes = {"x": [1.0, 0.0], "y": [0.0, 1.0]}
        ends = [(f"{factor.phrase} {preposition} {axis}", amount, numbers) for axis, numbers in axes.items()]
    for name, value, numbers in ends:
        end = {factor.name: amount * factor.to_internal * np.array(numbers)}
        yield SingleError(name, value, unit, (end,) * lamps)


def _shape(kind: LensOnBoard, factor: Factor) -> Float[np.ndarray, " k"]:
    """Numbers (mm) of a random shape whose rms along the normal, over the face, is the amount."""
    numbers = np.random.default_rng([_SHAPE_SEED, *factor.name.encode()]).standard_normal(factor.numbers)
    amount = factor.amount * factor.to_internal
    tables = kind.maker.errors[factor.name].tables
    if not len(tables):  # too fine for the tables: its slope counts, by the rms of its numbers
        return amount * numbers / float(np.sqrt(np.mean(numbers**2)))
    body = kind.lens.body
    u = kind.lens.directions(_SAMPLES)
    face = next(face for face in body.faces if factor.name.startswith(f"{face.name}_"))
    beside = body.bounding(face.before)
    u = u[nearest(beside, u) == beside.index(face)]
    cosine = np.sum(face.surface.normal(u) * u, axis=1)
    error = evaluate_table(kind.nominal.scene.grid, np.tensordot(numbers, tables, axes=1), u) * cosine
    return amount * numbers / float(np.sqrt(np.mean(error**2)))
