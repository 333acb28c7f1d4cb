"""States that are mirror images of each other: which are, and that one of them tells the light of both."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from presets import FEW
from scenes import small_spec

import lensforge as lf
from lensforge.light.lens_light import searched_source
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.merit import MeritFunction
from lensforge.search.merit_of_sources import MeritOfSources
from lensforge.search.parameters import SphereParameters
from lensforge.search.scene_symmetry import settled_symmetry, traced_source, traced_states
from lensforge.sources.several_sources import SeveralSources
from lensforge.spec import Spec
from lensforge.spec.source_sections import Chip, ChipsSource, SquareSource

BAR = {"kind": "chip_array", "columns": 4, "rows": 1, "width_mm": 0.4, "height_mm": 0.6, "pitch_mm": [0.5, 0.5]}
CROSSTALK = {"kind": "crosstalk", "at_most_share": 0.2, "neighbours": 1, "at_least_own_share": 0.4}


def segment(number: int, **changes: Any) -> dict[str, Any]:
    lit = [0.0] * 4
    lit[number] = 1.0
    target = {"kind": "rectangle", "width_deg": 14.0, "height_deg": 20.0, "centre_deg": [15.0 * (1.5 - number), 0.0]}
    return {"name": f"c{number}", "dimming": lit, "target": {**target, "half_angle_deg": 50.0}} | changes


def bar(**changes: dict[str, Any]) -> Spec:
    """A bar of four chips, each with its segment; ``c0=…``: changes of one state."""
    states = [segment(number, weight=(2.0, 1.0, 1.0, 2.0)[number]) for number in range(4)]
    states = [state | changes.get(state["name"], {}) for state in states]
    return small_spec(source=BAR, states=states, target=None, limits=[CROSSTALK], lens__symmetry="auto")


def settled(spec: Spec) -> Spec:
    return settled_symmetry(spec, searched_source(spec))


def test_a_mirror_that_maps_the_states_to_each_other_is_one_of_the_lens() -> None:
    spec = settled(bar())
    traced = traced_states(spec, searched_source(spec))
    assert spec.lens.symmetry == "rectangle"
    assert [(state.weight, state.spec.lens.symmetry) for state in traced] == [(4.0, "mirror_y"), (2.0, "mirror_y")]
    source = traced_source(spec, searched_source(spec))
    assert isinstance(source, SeveralSources) and len(source.sources) == 2
    assert settled(bar().replace({"lens.symmetry": "rectangle"})).lens.symmetry == "rectangle"


NARROW = {"target": {**segment(3)["target"], "width_deg": 13.0}}
HALF = {"kind": "zone", "zone": {"kind": "disc", "diameter_deg": 60.0}, "at_least_share": 0.5}


@pytest.mark.parametrize(
    "changes",
    [
        {"c3": {"weight": 1.5}},
        {"c3": NARROW},
        {"c3": {"dimming": [0.0, 0.0, 0.0, 0.5]}},
        {"c3": {"shift_mm": [0.0, 0.0, 0.1]}},
        {"c3": {"limits": [CROSSTALK, HALF]}},
        {"c3": {"limits": [{**CROSSTALK, "at_most_share": 0.3}]}},
    ],
    ids=["weight", "target", "flux", "place", "another limit", "its bound"],
)
def test_without_an_image_of_one_state_the_mirror_is_none_of_the_lens(changes: dict[str, Any]) -> None:
    spec = settled(bar(**changes))
    assert spec.lens.symmetry == "mirror_y" and len(traced_states(spec, searched_source(spec))) == 4
    with pytest.raises(lf.InputError, match=r"lens.symmetry = 'rectangle': the source has only 'mirror_y'"):
        settled(bar(**changes).replace({"lens.symmetry": "rectangle"}))


def test_leds_that_are_moved_and_tilted_to_both_sides_are_images() -> None:
    aim = {"kind": "rectangle", "width_deg": 10.0, "height_deg": 20.0, "half_angle_deg": 50.0}
    sides = [
        {"name": name, "shift_mm": [sign * 0.3, 0.1, 0.0], "tilt_deg": [3.0, sign * 8.0],
         "target": {**aim, "centre_deg": [sign * 12.0, 5.0]}}
        for name, sign in (("left", -1.0), ("right", 1.0))
    ]  # fmt: skip
    spec = small_spec(states=sides, target=None, lens__symmetry="auto")
    assert settled(spec).lens.symmetry == "mirror_x" and len(traced_states(settled(spec), searched_source(spec))) == 1
    sides[1]["tilt_deg"] = [3.0, -8.0]
    assert settled(small_spec(states=sides, target=None, lens__symmetry="auto")).lens.symmetry == "none"


@pytest.mark.parametrize("axis", ["x", "y"])
def test_the_image_of_an_led_stands_where_the_mirror_puts_it(axis: str) -> None:
    mirror = np.diag([-1.0 if name == axis else 1.0 for name in "xyz"])
    led = SquareSource(side_mm=1.0, position_mm=(0.3, -0.2, 0.1), tilt_deg=(20.0, -35.0), rotate_z_deg=15.0)
    image = led.mirrored(axis)
    np.testing.assert_allclose(image.pose.rotation, mirror @ led.pose.rotation @ mirror, atol=1e-15)
    np.testing.assert_allclose(image.pose.origin_mm, mirror @ led.pose.origin_mm, atol=1e-15)
    chips = [Chip(x_mm=x, y_mm=y, width_mm=0.4, height_mm=0.2) for x, y in ((0.5, 0.1), (-0.2, 0.3))]
    mirrored = ChipsSource(chips=chips).mirrored(axis)
    places = {(chip.x_mm, chip.y_mm) for chip in mirrored.chips}
    assert places == ({(-0.5, 0.1), (0.2, 0.3)} if axis == "x" else {(0.5, -0.1), (-0.2, -0.3)})


def test_the_loss_is_that_of_all_states_by_the_mirrored_rays() -> None:
    """Of a lens with the mirror, that is not round; the gradient is the same, too."""
    spec = settled(bar())
    source = searched_source(spec)
    parametrisation = SphereParameters.of(spec, 3.0)
    merit = MeritOfSources.of(spec, source, parametrisation)
    rng = np.random.default_rng(0)
    weights = torch.from_numpy(rng.normal(size=(parametrisation.basis.size, 2)) * 0.02).requires_grad_()
    offsets = torch.tensor([1.0, 1.05], dtype=torch.float64)
    rays = traced_source(spec, source).sample(2048, 1)
    constraints = AugmentedLagrangian.of(spec, parametrisation.grid)
    step = merit.step_loss(weights, offsets, rays, constraints, False)
    term = constraints.term(step.fields)
    left, inner = merit.source.shared_out(rays)
    flip = np.array([-1.0, 1.0, 1.0])
    own_rays = [
        left,
        inner,
        *(replace(r, origins=flip * r.origins, directions=flip * r.directions) for r in (inner, left)),
    ]
    losses = []
    for state, led, state_rays in zip(spec.by_state.values(), source.sources, own_rays, strict=True):
        alone = state.changed(lens=state.lens.changed(symmetry="mirror_y"))
        member = MeritFunction.of(alone, led, parametrisation)
        losses.append(member.step_loss(weights, offsets, state_rays, constraints, False).loss - term)
    wanted = sum(share * loss for share, loss in zip((2 / 6, 1 / 6, 1 / 6, 2 / 6), losses, strict=True))
    assert losses[0].item() == pytest.approx(losses[3].item(), rel=1e-12) and abs(losses[0] - losses[1]) > 1e-3
    assert (step.loss - term).item() == pytest.approx(wanted.item(), rel=1e-12)
    by_two, by_all = (torch.autograd.grad(loss, weights, retain_graph=True)[0] for loss in (step.loss, wanted + term))
    assert torch.allclose(by_two, by_all, rtol=1e-9, atol=1e-12) and float(by_all.abs().max()) > 1e-3


def test_a_search_lights_both_of_a_pair_alike() -> None:
    made = lf.design(bar(), accuracy=FEW)
    light = lf.evaluate(made.lens, rays=2**16)
    assert made.lens.symmetry == "rectangle"
    for led, partner in (("c0", "c3"), ("c1", "c2")):
        first, second = light.by_led[led], light.by_led[partner]
        error = np.hypot(first.efficiency.standard_error, second.efficiency.standard_error)
        assert abs(first.efficiency.value - second.efficiency.value) < 5.0 * error
        noise = (first.nmse_of_noise + second.nmse_of_noise) * np.sum(second.map**2)
        mirrored, as_it_is = (np.sum((light - second.map) ** 2) for light in (first.map[:, ::-1], first.map))
        assert mirrored < 1.5 * noise and as_it_is > 3.0 * noise
