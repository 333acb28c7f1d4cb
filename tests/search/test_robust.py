"""Robust searches: the merit that they lower is the mean over parts, exact in its gradient; what they gain and keep."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scenes import DEVICES, small_spec

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Progress
from lensforge.search.merit import MeritFunction, Problem, Problems
from lensforge.search.optimiser import search
from lensforge.search.robust_parts import Pair
from lensforge.search.validation_rays import ValidationRays
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.spec.accuracy import PRESETS, SearchEffort
from lensforge.spec.tolerances_section import PRESET_AMOUNTS

LARGE = {"source_shift_mm": 0.2, "source_height_mm": 0.2, "outer_shift_mm": 0.1, "inner_form_um": 20.0, "index": 0.01}
WHITE = {"kind": "table", "wavelength_nm": [440.0, 460.0, 550.0, 680.0], "weight": [0.0, 1.0, 0.6, 0.0]}
SPECS: dict[str, dict[str, Any]] = {
    "standard": {},
    "large": {"tolerances": LARGE},
    "symmetric": {"tolerances": LARGE, "lens__symmetry": "square"},
    "dispersed": {"source": {"kind": "square", "side_mm": 1.0, "spectrum": WHITE}, "lens__material": "PC"},
}
ALL = tuple(PRESET_AMOUNTS["standard"])
FEW = SearchEffort(25, (4, 6), (256, 512), 512, 0.5, 0.05)


def robust(**changes: Any) -> Spec:
    return small_spec(optimise__robust=True, **changes)


def problem_of(spec: Spec) -> Problem:
    return Problems(spec, build_source(spec.source, spec.lens.dispersion), 3.0, None).of((9, 25))


class Step:
    """Merit of one step from a lens that is not round, through two parts."""

    def __init__(self, spec: Spec, rays: int = 2048) -> None:
        self.problem, rng = problem_of(spec), np.random.default_rng(0)
        assert self.problem.parts is not None
        self.pair = self.problem.parts.of_step(0, 3)
        self.merit = self.problem.merit
        self.weights = torch.from_numpy(rng.normal(size=(34, 2)) * 0.01).requires_grad_()
        self.offsets = torch.tensor([1.0, 1.1], dtype=torch.float64, requires_grad=True)
        self.ways = torch.from_numpy(rng.normal(size=(34, 2))), torch.from_numpy(rng.normal(size=2))
        self.rays = build_source(spec.source, spec.lens.dispersion).sample(rays, 1)

    def designed(self) -> torch.Tensor:
        """The merit of the lens as designed."""
        return self._loss(0.0, None, self.merit)

    def loss(self, by: float = 0.0, device: str | None = None) -> torch.Tensor:
        merit = self.merit
        if device is not None:
            merit = replace(merit, light=replace(merit.light, device=torch.device(device)))
        return self._loss(by, self.pair, merit)

    def _loss(self, by: float, pair: Pair | None, merit: MeritFunction) -> torch.Tensor:
        parameters = self.weights + by * self.ways[0], self.offsets + by * self.ways[1]
        return merit.evaluate(*parameters, self.rays, self.problem.constraints, True, pair).loss


@pytest.mark.parametrize("changes", SPECS.values(), ids=SPECS)
def test_the_gradient_is_that_of_differences(changes: dict[str, Any]) -> None:
    step, by = Step(robust(**changes)), 1e-8
    gradients = torch.autograd.grad(step.loss(), (step.weights, step.offsets))
    with torch.no_grad():
        change = (step.loss(by) - step.loss(-by)).item() / (2.0 * by)
    along = sum((gradient * way).sum().item() for gradient, way in zip(gradients, step.ways, strict=True))
    assert change == pytest.approx(along, rel=2e-4)


@pytest.mark.parametrize("device", DEVICES)
def test_loss_and_gradient_on_a_device_are_those_of_the_kernels(device: str) -> None:
    step = Step(robust(tolerances=LARGE))
    one, other = (
        (loss, *torch.autograd.grad(loss, (step.weights, step.offsets)))
        for loss in (step.loss(), step.loss(device=device))
    )
    for a, b in zip(one, other, strict=True):
        assert torch.linalg.norm(a - b) <= 1e-10 * torch.linalg.norm(b)


def test_without_deviations_it_is_the_merit_of_the_lens_as_designed() -> None:
    zero = dict.fromkeys(ALL, 0.0)
    step = Step(robust(tolerances={**zero, "source_shift_mm": 1e-10, "outer_form_um": 1e-7, "index": 1e-12}))
    with torch.no_grad():
        assert step.loss().item() == pytest.approx(step.designed().item(), rel=1e-9)


def test_it_is_the_mean_of_the_merits_of_both_parts() -> None:
    """The merit of each part by itself, with the light path of one part alone."""
    step = Step(robust(tolerances=LARGE))
    merit = step.merit
    with torch.no_grad():
        tables = merit.parametrisation.tables(step.weights, step.offsets)
        constraint = step.problem.constraints.term(step.problem.constraints.fields(*tables))
        emitted, total = float(step.rays.flux.sum()), 0.0
        for part in step.pair:
            (light,) = merit.light.through(*tables, step.rays, part)
            own = merit.terms[0].loss(light.image, True) + merit._flux_term((light,)) / emitted
            total += 0.5 * own.item()
        assert step.loss().item() == pytest.approx(total + constraint.item(), rel=1e-12)
        assert abs(step.designed().item() / step.loss().item() - 1.0) > 1e-3


def test_the_spread_over_parts_counts() -> None:
    """Opposite parts whose mean image is that of the design still have an error of their own."""
    step = Step(robust(tolerances=LARGE))
    with torch.no_grad():
        tables = step.problem.merit.parametrisation.tables(step.weights, step.offsets)
        light = step.merit.light_of(*tables, step.rays, step.pair)
    wanted = step.problem.merit.terms[0].wanted
    errors = [float(((images[0] - wanted) ** 2).sum()) for images in light.of_parts()]
    of_mean, of_half = (float((each**2).sum()) for each in (light.images[0] - wanted, light.halves[0][0]))
    assert np.mean(errors) == pytest.approx(of_mean + of_half, rel=1e-12)
    assert of_half > 0.0


def test_steps_draw_other_parts_and_the_same_again() -> None:
    parts, again = (problem_of(robust()).parts for _ in range(2))
    assert parts is not None and again is not None
    far = parts.of_step(1, 5000)[0].made  # of another block than the first
    made = [parts.of_step(1, number)[0].made for number in range(3)]
    assert len({str(each) for each in (*made, far)}) == 4
    assert [again.of_step(1, number)[0].made for number in range(3)] == made
    assert again.of_step(1, 5000)[0].made == far
    assert parts.of_step(2, 0)[0].made != made[0]
    assert parts.of_validation(1, 2)[0][0].made != made[0]
    one, other = parts.of_step(1, 0)
    assert np.allclose(np.array(one.made.source.shift_mm), -np.array(other.made.source.shift_mm))
    assert np.allclose(one.outer_error, -other.outer_error) and one.index == -other.index
    assert one.made.inner_slope == other.made.inner_slope


def test_fine_errors_scatter_as_roughness() -> None:
    plain, rough = (
        problem_of(robust(tolerances=dict.fromkeys(ALL, 0.0) | own)).parts
        for own in ({"outer_form_um": 1.0}, {"outer_waviness_um": 1.0})
    )
    assert plain is not None and rough is not None
    assert plain.of_step(0, 0)[0].made.outer_slope == 0.0
    part = rough.of_step(0, 0)[0]
    assert part.outer_error is None and 1e-4 < part.made.outer_slope < 1e-2


def test_a_spec_without_deviations_is_refused_in_one_line() -> None:
    spec = robust(tolerances=dict.fromkeys(ALL, 0.0))
    with pytest.raises(InputError, match="tolerances: all of them are 0"):
        search(spec, build_source(spec.source), accuracy="draft")


def test_tolerances_change_a_robust_search_and_no_other(tmp_path: Path) -> None:
    def lens(spec: Spec) -> Lens:
        return search(spec, build_source(spec.source), accuracy="draft").lens

    def weights(spec: Spec) -> bytes:
        return lens(spec).inner.weights_mm.tobytes()  # type: ignore[attr-defined]

    assert weights(small_spec()) == weights(small_spec(tolerances=LARGE))
    assert len({weights(spec) for spec in (small_spec(), robust(), robust(tolerances=LARGE))}) == 3


@pytest.mark.parametrize("levels", [[9, 25], "auto"])
def test_an_interrupted_search_goes_on_to_the_same_bits(
    levels: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Stop(KeyboardInterrupt):
        pass

    def stop(progress: Progress) -> None:
        if progress.steps_done == 5:
            raise Stop

    monkeypatch.setitem(PRESETS, "draft", replace(PRESETS["draft"], effort=FEW))
    given = {"optimise__steps_per_level": None, "optimise__rays": None} if levels == "auto" else {}
    spec, path = robust(lens__levels=levels, tolerances=LARGE, **given), tmp_path / "checkpoint.bin"
    source = build_source(spec.source)
    whole = search(spec, source, accuracy="draft", seed=3)
    with pytest.raises(Stop):
        search(spec, source, accuracy="draft", seed=3, checkpoint=path, progress=stop)
    other = spec.replace({"tolerances.source_shift_mm": 0.1})
    with pytest.raises(InputError, match="belongs to another spec"):
        search(other, source, accuracy="draft", seed=3, checkpoint=path, resume=True)
    resumed = search(spec, source, accuracy="draft", seed=3, checkpoint=path, resume=True)
    assert resumed.lens.sha256 == whole.lens.sha256 and resumed.history == whole.history


def test_a_robust_lens_is_better_on_average_over_other_parts() -> None:
    changes = {"optimise__steps_per_level": [30, 40], "optimise__rays": 4096, "optimise__pixels": 16}
    changes |= {"tolerances": {"source_shift_mm": 0.5, "lens_shift_mm": 0.3}}
    expected = []
    for robustly in (False, True):
        spec = small_spec(optimise__robust=robustly, **changes)
        lens = search(spec, build_source(spec.source), accuracy="draft").lens
        expected.append(expected_merit(lens))
    assert expected[1] < 0.98 * expected[0]


def expected_merit(lens: Lens) -> float:
    """Mean merit over parts and rays that no search has seen."""
    spec = lens.spec.replace(optimise={"robust": True})
    problem = problem_of(spec)
    validation, _ = ValidationRays.of(build_source(spec.source), 2**15, 77)
    found, _ = validation.judge(problem, *problem.parametrisation.parameters_of(lens), False)
    return found.merit
