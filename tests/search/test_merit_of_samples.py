"""Light of samples, parts and halves, and the merit by two of them, from pictures that are given."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from scenes import small_spec

from lensforge.scene.as_made import AsMade
from lensforge.scene.made_part import MadePart
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.light_path import Collected, LightPath
from lensforge.search.merit import ImageTerms, MeritFunction, SampledLight, limit_terms, nmse_loss
from lensforge.sources.build_source import SquareEmitter


def tensor(values: Any) -> torch.Tensor:
    return torch.from_numpy(np.asarray(values, dtype=np.float64))


def sample(seed: int, emitted_w: float, pairs: int = 0) -> SampledLight:
    chance = np.random.default_rng(seed)
    pictures = tuple(tensor(chance.random(shape)) for shape in ((3, 4), (2, 2)))
    halves = tuple(tuple(0.1 * tensor(chance.random(shape)) for shape in ((3, 4), (2, 2))) for _ in range(pairs))
    return SampledLight(pictures, tensor(chance.random()), emitted_w, halves)


def test_joined_samples_count_by_what_they_emit() -> None:
    parts = [sample(1, 0.5, 1), sample(2, 1.5, 1)]
    whole = SampledLight.joined(parts, 4.0)
    for k in range(2):
        np.testing.assert_allclose(whole.images[k], 2.0 * (parts[0].images[k] + parts[1].images[k]))
        np.testing.assert_allclose(whole.halves[0][k], 8.0 * parts[0].halves[0][k])
        np.testing.assert_allclose(whole.halves[1][k], 4.0 / 1.5 * parts[1].halves[0][k])
    assert whole.terms.item() == pytest.approx(2.0 * (parts[0].terms + parts[1].terms).item())
    assert whole.emitted_w == 4.0
    alone = sample(1, 0.5)
    assert len(alone.of_parts()) == 1 and alone.of_parts()[0] is alone.images
    both = parts[0].of_parts()
    assert len(both) == 2
    for k in range(2):
        np.testing.assert_allclose(both[0][k], parts[0].images[k] + parts[0].halves[0][k])
        np.testing.assert_allclose(both[1][k], parts[0].images[k] - parts[0].halves[0][k])


class Known(LightPath):
    """A path whose light is given: of the lens as designed, and of two parts."""

    def collect(self, inner: Any, outer: Any, rays: Any) -> tuple[Collected, ...]:
        return known(5)

    def through(self, inner: Any, outer: Any, rays: Any, part: Any) -> tuple[Collected, ...]:
        return known(int(part.index))


def part(number: int) -> MadePart:
    """A part whose light is ``known(number)``."""
    return MadePart(None, None, object.__new__(AsMade), float(number), 0.0)


def known(seed: int) -> tuple[Collected, ...]:
    chance = np.random.default_rng(seed)
    return tuple(Collected(tensor(chance.random((n, n))), *tensor(chance.random(3))) for n in (8, 6))


PLANE = {"kind": "plane", "centre_mm": [0.0, 0.0, 60.0], "width_mm": 80.0, "height_mm": 80.0, "share": 3.0,
         "targets": [{"kind": "disc", "diameter_mm": 40.0, "uniform_mm": 20.0}]}  # fmt: skip
DOME = {"kind": "sphere", "radius_mm": 50.0, "half_angle_deg": 60.0, "targets": [{"kind": "disc", "diameter_mm": 40.0}]}


def merit(*limits: dict[str, Any], even: bool = True) -> MeritFunction:
    plane = PLANE if even else {**PLANE, "targets": [{"kind": "disc", "diameter_mm": 40.0}]}
    spec = small_spec(target=None, receivers=[plane, DOME]).replace(limits=limits)
    grid = SimpleNamespace(grid=None)
    made = object.__new__(MeritFunction)
    plane_receiver, dome = (receivers_of(spec, side)[k] for k, side in ((0, 8), (1, 6)))
    terms = tuple(
        ImageTerms.of(section.targets, receiver, 2.0, "none", share)
        for section, receiver, share in zip(spec.all_receivers, (plane_receiver, dome), (0.75, 0.25), strict=True)
    )
    fields = {"spec": spec, "parametrisation": grid, "terms": terms, "light": object.__new__(Known),
              "limits": limit_terms(spec, (plane_receiver, dome), None, 2.0)}  # fmt: skip
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made


TABLE = torch.ones(4, 4, dtype=torch.float64)


LIMIT = {"kind": "zone", "unit": "w_per_m2", "at_least": 1e4}


class Free(AugmentedLagrangian):
    """Constraints whose term is a quarter."""

    def fields(self, inner: torch.Tensor, outer: torch.Tensor) -> torch.Tensor:
        return tensor([[2.0, 3.0]])

    def term(self, fields: torch.Tensor) -> torch.Tensor:
        return tensor(0.25)


@pytest.mark.parametrize("uniform", [False, True])
@pytest.mark.parametrize("robust", [False, True])
def test_a_step_minimises_the_mean_over_its_parts_and_says_their_error_and_efficiency(
    robust: bool, uniform: bool
) -> None:
    made, rays = (
        merit(LIMIT, {**LIMIT, "unit": "w_per_m2", "at_least": 2e4}),
        SquareEmitter(1.0, flux_w=1.5).sample(64, 0),
    )
    object.__setattr__(made, "parametrisation", SimpleNamespace(tables=lambda weights, offsets: (TABLE, TABLE)))
    pair = (part(1), part(2)) if robust else None
    nothing = torch.zeros(1, 2, dtype=torch.float64)
    found = made.evaluate(nothing, nothing[0], rays, object.__new__(Free), uniform, pair)
    light = made.light_of(TABLE, TABLE, rays, pair)
    parts = light.of_parts()
    assert len(parts) == (2 if robust else 1)
    errors, losses = [], []
    for images in parts:
        both = list(zip(made.terms, images, strict=True))
        errors.append(sum(t.share * nmse_loss(image, t.wanted).item() for t, image in both))
        of_limits = sum(limit.loss(images).item() for limit in made.limits)
        losses.append(sum(t.share * t.loss(image, uniform).item() for t, image in both) + of_limits)
    assert found.nmse == pytest.approx(np.mean(errors))
    arrived = sum(t.share * image.sum().item() for t, image in zip(made.terms, light.images, strict=True))
    assert found.efficiency == pytest.approx(arrived / 1.5)
    assert found.loss.item() == pytest.approx(np.mean(losses) + light.terms.item() / 1.5 + 0.25)
    assert found.fields.tolist() == [[2.0, 3.0]]
