"""The merit function with receivers of every kind, and with several: gradients, shares, and mirror images."""

from typing import Any

import numpy as np
import pytest
import torch
from scenes import DEVICES, small_spec

from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.merit import MeritFunction
from lensforge.search.parameters import Parametrisation
from lensforge.search.symmetry import chart_mirrors, mirrored_light, settled_symmetry
from lensforge.sources.build_source import SquareEmitter, build_source
from lensforge.spec import Spec

RECEIVERS: dict[str, dict[str, Any]] = {
    "tilted plane": {
        "kind": "plane", "centre_mm": [60.0, 20.0, 90.0], "tilt_deg": [-12.0, 30.0], "rotation_deg": 20.0,
        "width_mm": 200.0, "height_mm": 120.0,
        "targets": [{"kind": "disc", "diameter_mm": 60.0, "edge_mm": 4.0, "uniform_mm": 40.0}],
    },
    "far field": {
        "kind": "far_field", "half_angle_deg": 70.0, "axis": [0.1, 0.0, 1.0],
        "targets": [{"kind": "beam", "fwhm_deg": [40.0, 30.0]}],
    },
    "cylinder": {
        "kind": "cylinder", "radius_mm": 80.0, "width_mm": 200.0, "height_mm": 120.0, "rotation_deg": 10.0,
        "targets": [{"kind": "cross", "length_mm": 80.0, "stroke_mm": 30.0}],
    },
    "sphere": {
        "kind": "sphere", "radius_mm": 80.0, "half_angle_deg": 70.0, "centre_mm": [3.0, -4.0, 5.0],
        "targets": [{"kind": "rectangle", "width_mm": 90.0, "height_mm": 60.0}],
    },
}  # fmt: skip
SETS = {**{name: [each] for name, each in RECEIVERS.items()}, "all of them": list(RECEIVERS.values())}


def spec_of(receivers: list[dict[str, Any]]) -> Spec:
    return small_spec(target=None, receivers=receivers)


class Step:
    """Merit and rays of one step from a lens that is not round."""

    def __init__(self, receivers: list[dict[str, Any]]) -> None:
        spec = spec_of(receivers)
        source, parametrisation = build_source(spec.source), Parametrisation.of(spec, 4.0)
        self.merit = MeritFunction.of(spec, source, parametrisation)
        self.constraints = AugmentedLagrangian.of(spec, parametrisation.grid)
        rng = np.random.default_rng(0)
        self.weights = torch.from_numpy(rng.normal(size=(parametrisation.basis.size, 2)) * 0.01).requires_grad_()
        self.offsets = torch.tensor([1.0, 1.1], dtype=torch.float64, requires_grad=True)
        self.rays = source.sample(2048, 1)
        self.ways = torch.from_numpy(rng.normal(size=self.weights.shape)), torch.from_numpy(rng.normal(size=2))

    def loss(self, by: float = 0.0, device: str | None = None) -> torch.Tensor:
        merit = self.merit
        if device is not None:
            from dataclasses import replace

            merit = replace(merit, light=replace(merit.light, device=torch.device(device)))
        weights, offsets = self.weights + by * self.ways[0], self.offsets + by * self.ways[1]
        return merit.evaluate(weights, offsets, self.rays, self.constraints, uniform=True).loss


@pytest.mark.parametrize("receivers", SETS.values(), ids=list(SETS))
def test_the_gradient_is_that_of_differences(receivers: list[dict[str, Any]]) -> None:
    step, by = Step(receivers), 1e-8
    gradients = torch.autograd.grad(step.loss(), (step.weights, step.offsets))
    with torch.no_grad():
        change = (step.loss(by) - step.loss(-by)).item() / (2.0 * by)
    along = sum((gradient * way).sum().item() for gradient, way in zip(gradients, step.ways, strict=True))
    assert change == pytest.approx(along, rel=2e-4)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("receivers", SETS.values(), ids=list(SETS))
def test_torch_on_a_device_has_the_same_loss_and_gradient(receivers: list[dict[str, Any]], device: str) -> None:
    step = Step(receivers)
    one, other = step.loss(), step.loss(device=device)
    assert other.item() == pytest.approx(one.item(), rel=1e-10)
    first, second = (torch.autograd.grad(loss, step.weights)[0] for loss in (one, other))
    assert torch.linalg.norm(first - second) < 1e-9 * torch.linalg.norm(first)


def test_receivers_count_by_their_shares() -> None:
    """Each alone, and both together with shares of 3 to 1; the light near total reflection counts once."""
    first, second = RECEIVERS["far field"], RECEIVERS["sphere"]
    alone = [Step([each]).loss().item() for each in (first, second)]
    both = Step([{**first, "share": 3.0}, second])
    assert both.loss().item() == pytest.approx(0.75 * alone[0] + 0.25 * alone[1], rel=1e-9)


@pytest.mark.parametrize("fresnel", [True, False])
def test_the_wanted_light_is_that_of_the_source_less_what_both_faces_reflect_at_least(fresnel: bool) -> None:
    spec = small_spec(target=None, receivers=[RECEIVERS["sphere"]], optimise__fresnel=fresnel)
    merit = MeritFunction.of(spec, SquareEmitter(1.0, flux_w=2.5), Parametrisation.of(spec, 4.0))
    index = spec.lens.refractive_index
    passed = (4.0 * index / (index + 1.0) ** 2) ** 2 if fresnel else 1.0  # Born and Wolf, 1.5.3
    assert merit.terms[0].wanted.sum().item() == pytest.approx(2.5 * passed, rel=1e-12)


def mirrored(**changes: Any) -> str:
    """The symmetry found for a disc on a receiver."""
    kind = changes.pop("kind", "plane")
    size = {"half_angle_deg": 60.0} if kind in ("far_field", "sphere") else {"width_mm": 200.0, "height_mm": 200.0}
    target = {"kind": "disc", "diameter_mm": 60.0}
    if kind == "far_field":
        target = {"kind": "disc", "diameter_deg": 40.0}
    target |= changes.pop("target", {})
    spec = small_spec(target=None, receivers=[{"kind": kind, "targets": [target], **size, **changes}])
    spec = spec.replace({"lens.symmetry": "auto"})
    return settled_symmetry(spec, SquareEmitter(1.0)).lens.symmetry


@pytest.mark.parametrize(
    ("changes", "symmetry"),
    [
        ({"centre_mm": [0.0, 0.0, 100.0]}, "square"),
        ({"centre_mm": [0.0, 0.0, 100.0], "rotation_deg": 90.0}, "square"),
        ({"centre_mm": [0.0, 0.0, 100.0], "height_mm": 150.0}, "rectangle"),
        ({"centre_mm": [0.0, 0.0, 100.0], "target": {"centre_mm": [20.0, 0.0]}}, "mirror_y"),
        ({"centre_mm": [40.0, 0.0, 90.0], "tilt_deg": [0.0, 30.0]}, "mirror_y"),
        ({"centre_mm": [0.0, 40.0, 90.0], "tilt_deg": [-30.0, 0.0]}, "mirror_x"),
        ({"centre_mm": [0.0, 40.0, 90.0], "tilt_deg": [-30.0, 0.0], "rotation_deg": 90.0}, "mirror_x"),
        ({"centre_mm": [0.0, 40.0, 90.0], "tilt_deg": [-30.0, 0.0], "rotation_deg": 45.0}, "mirror_x"),
        ({"centre_mm": [0.0, 40.0, 90.0], "tilt_deg": [-30.0, 0.0], "rotation_deg": 30.0}, "none"),
        ({"centre_mm": [30.0, 40.0, 90.0]}, "none"),
        ({"kind": "far_field"}, "square"),
        ({"kind": "far_field", "axis": [0.2, 0.0, 1.0]}, "mirror_y"),
        ({"kind": "cylinder", "radius_mm": 80.0}, "rectangle"),
        ({"kind": "sphere", "radius_mm": 80.0}, "square"),
        ({"kind": "sphere", "radius_mm": 80.0, "centre_mm": [5.0, 0.0, 0.0]}, "mirror_y"),
    ],
)
def test_symmetry_is_found_for_every_receiver(changes: dict[str, Any], symmetry: str) -> None:
    assert mirrored(**changes) == symmetry


def test_mirror_images_of_light_are_those_of_its_rays() -> None:
    """A ray and its mirror images in the lens's axes land where the image is mirrored."""
    tilted = RECEIVERS["tilted plane"] | {
        "centre_mm": [0.0, 20.0, 90.0],
        "tilt_deg": [-12.0, 0.0],
        "rotation_deg": 90.0,
    }
    receiver = receivers_of(spec_of([tilted]), 32)[0]
    mirrors = chart_mirrors(receiver, "mirror_x")
    assert mirrors is not None
    image = torch.zeros(receiver.grid.shape, dtype=torch.float64)
    image[3, 7] = 1.0
    rows, columns = np.nonzero(mirrored_light(image, mirrors).numpy())
    places = receiver.places(receiver.grid.x()[columns], receiver.grid.y()[rows])
    assert len(places) == 2 and np.allclose(places[0] * [-1.0, 1.0, 1.0], places[1])
