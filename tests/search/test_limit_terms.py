"""Limits in the merit function: nothing where they are held, gradients by finite differences, and a search for them."""

import numpy as np
import pytest
import torch
from scenes import small_spec

from lensforge.optics.efficacy import Efficacy
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.automatic_schedule import preset_for
from lensforge.search.limit_terms import LimitTerm
from lensforge.spec import Spec
from lensforge.spec.accuracy import preset_of

BEAM = {"kind": "beam", "fwhm_deg": 30.0, "half_angle_deg": 60.0}
LIMITS = [
    {"kind": "points", "at_deg": [[0, 0], [15, 0]], "unit": "w_per_sr", "at_least": 3.0},
    {"kind": "points", "at_deg": [[0, 0], [15, 0]], "unit": "w_per_sr", "at_most": 3.0},
    {"kind": "glare", "from_deg": 20.0, "unit": "relative", "at_most": 0.1},
    {"kind": "zone", "zone": {"kind": "disc", "diameter_deg": 20.0}, "at_least_min_over_mean": 0.9},
    {"kind": "zone", "zone": {"kind": "disc", "diameter_deg": 20.0}, "at_least_min_over_max": 0.9},
    {"kind": "zone", "zone": {"kind": "disc", "diameter_deg": 20.0}, "at_least_share": 0.9},
    {"kind": "beam_angle", "at_least_deg": 40.0},
    {"kind": "beam_angle", "at_most_deg": 25.0},
]


def scene(*limits: dict[str, object]) -> tuple[Spec, torch.Tensor]:
    """A spec, and the picture of a beam of 30 degrees with 5 W/sr on its axis."""
    spec = small_spec(target=BEAM).replace(limits=limits)
    receiver = receivers_of(spec, 64)[0]
    x, y = receiver.target_coordinates(*np.meshgrid(receiver.grid.x(), receiver.grid.y()))
    light = 5.0 * np.exp(-4.0 * np.log(2.0) * ((x / 30.0) ** 2 + (y / 30.0) ** 2)) * receiver.pixel_measure
    return spec, torch.from_numpy(light)


@pytest.mark.parametrize("limit", LIMITS, ids=str)
def test_an_excess_costs_and_its_gradient_is_that_of_finite_differences(limit: dict[str, object]) -> None:
    spec, picture = scene(limit)
    (term,) = map(LimitTerm.of, light_limits(spec, receivers_of(spec, 64), Efficacy(), 1.0))
    rng = np.random.default_rng(0)
    picture = (picture * torch.from_numpy(1.0 + 0.05 * rng.random(picture.shape))).requires_grad_()
    loss = term.loss((picture,))
    assert loss.item() > 0.0
    (gradient,) = torch.autograd.grad(loss, picture)
    way = torch.from_numpy(rng.normal(size=picture.shape)) * picture.detach()
    if limit.get("unit") == "relative" or limit["kind"] == "beam_angle" or "at_least_min_over_max" in limit:
        way = way * (picture.detach() < 0.8 * picture.detach().max())  # the maximum is a scale, held as a constant
    step = 1e-6
    up, down = (term.loss((picture.detach() + sign * step * way,)).item() for sign in (1.0, -1.0))
    assert (up - down) / (2.0 * step) == pytest.approx(float((gradient * way).sum()), rel=1e-4, abs=1e-9)


def test_limits_that_are_held_with_the_margin_cost_nothing() -> None:
    held = [
        {"kind": "points", "at_deg": [[0, 0], [15, 0]], "unit": "w_per_sr", "at_least": 2.3},
        {"kind": "zone", "unit": "w_per_sr", "at_most": 5.3},
        {"kind": "glare", "from_deg": 30.0, "unit": "relative", "at_most": 0.08},
        {"kind": "beam_angle", "at_least_deg": 28.0, "at_most_deg": 32.0},
    ]
    spec, picture = scene(*held)
    terms = tuple(map(LimitTerm.of, light_limits(spec, receivers_of(spec, 64), Efficacy(), 1.0)))
    assert len(terms) == 5 and [term.loss((picture,)).item() for term in terms] == [0.0] * 5


@pytest.mark.parametrize(("limit", "rays"), [(LIMITS[0], 2**15), (LIMITS[5], 2**13), ({}, 2**13)], ids=str)
def test_only_limits_that_read_places_take_more_rays(limit: dict[str, object], rays: int) -> None:
    spec = small_spec(target=BEAM).replace(limits=[limit] if limit else [], optimise={"pixels": 128})
    assert preset_for(spec, "draft").effort.rays[0] == rays
    preset = preset_of("draft").replace("own", effort={"rays": (2**10, 2**11)})
    assert preset_for(spec, preset) == preset
