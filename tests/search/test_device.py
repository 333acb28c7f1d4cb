"""A search whose rays are traced in torch on a device is the search by the kernels, to rounding."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from presets import FEW_STEPS
from scenes import DEVICES, small_spec
from test_bodies import COVER, spec_with
from test_reflector import reflector
from tir_lenses import spot

from lensforge.errors import InputError
from lensforge.search.checkpoint import CHECKPOINT as FILE_NAME
from lensforge.search.merit import MeritFunction
from lensforge.search.optimiser import search
from lensforge.search.problem import parameters_of
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec

CPU = torch.device("cpu")


@pytest.mark.parametrize("device", DEVICES)
def test_a_design_ends_where_the_kernels_end(device: str) -> None:
    double = FEW_STEPS.replace("double", single=False)
    spec = small_spec(optimise__steps_per_level=[2, 1], optimise__rays=256)
    source = build_source(spec.source)
    kernels, in_torch = (search(spec, source, accuracy=double, device=d) for d in (None, torch.device(device)))
    for level, expected in zip(in_torch.history, kernels.history, strict=True):
        assert level.loss == pytest.approx(expected.loss, rel=1e-8)
    assert np.allclose(in_torch.lens.outer.weights_mm, kernels.lens.outer.weights_mm, rtol=1e-6, atol=1e-9)


def test_a_checkpoint_is_not_resumed_on_another_device(tmp_path: Path) -> None:
    spec = small_spec(optimise__steps_per_level=[1, 1], optimise__rays=256)
    source = build_source(spec.source)
    given = {"accuracy": FEW_STEPS, "checkpoint": tmp_path / FILE_NAME}
    search(spec, source, **given, device=CPU)
    search(spec, source, **given, device=CPU, resume=True)
    with pytest.raises(InputError, match="start or device"):
        search(spec, source, **given, resume=True)


FLANGE = {"diameter_mm": 20.0, "thickness_mm": 1.0, "setback_mm": 0.15}
WIDE = COVER | {"inner": {"fixed": {"kind": "sphere", "radius_mm": 20.0}},
                "outer": {"fixed": {"kind": "sphere", "radius_mm": 23.0, "centre_z_mm": -1.0}}}  # fmt: skip
BODIES: dict[str, Callable[[], Spec]] = {
    "TIR, of levels, absorbing, with limits on losses": lambda: spot(levels=[9], absorption_per_mm=0.02).replace(
        limits=[{"kind": "loss", "cause": cause, "at_most_share": 1e-4} for cause in ("beside", "wall")]
    ),
    "TIR, with a flange": lambda: spot(flange=FLANGE).replace(base={"kind": "cylinder", "diameter_mm": 7.0}),
    "reflector": reflector,
    "two faces before a cover": spec_with,
    "TIR between walls": lambda: spot().replace(
        scene=[
            {
                "kind": "box",
                "name": name,
                "size_mm": [4.0, 90.0, 60.0],
                "centre_mm": [x, 3.0, 60.0],
                "reflectance": 0.8,
                "surface": surface,
            }
            for name, x, surface in (("left", -21.0, "mirror"), ("right", 17.0, "diffuse"))
        ]
    ),
    "TIR before a cover": lambda: spot().replace(bodies=[WIDE]),
}


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", BODIES)
def test_a_step_of_any_body_is_that_of_the_kernels(name: str, device: str) -> None:
    """Its merit and the gradient, light that crosses creases included."""
    spec = BODIES[name]()
    rng = np.random.default_rng(5)
    source = build_source(spec.source, spec.lens.dispersion)
    parameters = parameters_of(spec, 2.5)
    weights, offsets = parameters.start()
    tensors = [(weights + 0.003 * torch.from_numpy(rng.normal(size=weights.shape))).requires_grad_()]
    tensors.append((offsets + 0.003).requires_grad_())
    values = []
    for place in (None, torch.device(device)):
        merit = MeritFunction.of(spec, source, parameters, place)
        loss = merit.training_loss(
            merit.light_of(parameters.tables(*tensors), source.sample(2**10, 3)), uniform=False
        ).loss
        values.append((loss.detach(), *torch.autograd.grad(loss, tensors)))
    for one, other in zip(*values, strict=True):
        assert torch.linalg.norm(one - other) <= 1e-8 * torch.linalg.norm(other)
