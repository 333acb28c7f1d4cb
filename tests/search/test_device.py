"""A search whose rays are traced in torch on a device is the search by the kernels, to rounding."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import DEVICES, small_spec

from lensforge.errors import InputError
from lensforge.search import light_path
from lensforge.search.checkpoint import CHECKPOINT as FILE_NAME
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.merit import MeritFunction
from lensforge.search.optimiser import search
from lensforge.search.parameters import Parametrisation
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle

CPU = torch.device("cpu")
LED = Path(__file__).parents[2] / "examples" / "led.tm25ray"
SPHERE = {"kind": "sphere", "radius_mm": 3.0, "centre_z_mm": -1.0}
DOME = {"kind": "asphere", "vertex_z_mm": 6.5, "radius_mm": -6.0, "conic_constant": -0.2, "coefficients": [-1e-5]}
WHITE = {"kind": "table", "wavelength_nm": [440.0, 460.0, 550.0, 680.0], "weight": [0.0, 1.0, 0.6, 0.0]}
SPECS = {
    "free": {},
    "symmetric": {"lens__symmetry": "square"},
    "fixed inner": {"lens": {"levels": [9, 25], "fixed_inner": SPHERE, "outer_offset_mm": 6.0}},
    "fixed outer": {"lens": {"levels": [9, 25], "inner_offset_mm": 3.0, "fixed_outer": DOME}},
    "ray file": {"source": {"kind": "rayfile", "file": str(LED), "origin": "virtual_focus"}},
    "dispersed": {"source": {"kind": "square", "side_mm": 1.0, "spectrum": WHITE}, "lens__material": "PC"},
    "lossless": {"optimise__fresnel": False},
}


class _Step:
    """Loss and gradients of one step from a lens that is not round."""

    def __init__(self, changes: dict, rays: int = 2000) -> None:
        spec = small_spec(**changes)
        source = build_source(spec.source, spec.lens.dispersion)
        parametrisation = Parametrisation.of(spec, 3.0)
        self.merit = MeritFunction.of(spec, source, parametrisation)
        self.constraints = AugmentedLagrangian.of(spec, parametrisation.grid)
        weights = np.random.default_rng(0).normal(size=(parametrisation.basis.size, 2)) * 0.02
        self.parameters = torch.from_numpy(weights).requires_grad_(), torch.ones(2).double().requires_grad_()
        self.rays: RayBundle = source.sample(rays, 1)

    def __call__(self, **light) -> tuple[torch.Tensor, ...]:
        merit = replace(self.merit, light=replace(self.merit.light, **light))
        loss = merit.evaluate(*self.parameters, self.rays, self.constraints, uniform=True).loss
        return loss.detach(), *torch.autograd.grad(loss, self.parameters)


def _close(one: tuple[torch.Tensor, ...], other: tuple[torch.Tensor, ...]) -> bool:
    return all(torch.linalg.norm(a - b) <= 1e-10 * torch.linalg.norm(b) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("changes", SPECS.values(), ids=SPECS)
def test_loss_and_gradient_are_those_of_the_kernels(changes: dict, device: str) -> None:
    step = _Step(changes)
    assert _close(step(device=torch.device(device)), step())


def test_chunks_add_up_and_search_for_each_crossing_once(monkeypatch: pytest.MonkeyPatch) -> None:
    step = _Step({})
    whole = step(device=CPU)
    searched: list[int] = []
    search = light_path.first_crossing
    monkeypatch.setattr(light_path, "first_crossing", lambda t, o, d: (searched.append(len(o)), search(t, o, d))[1])
    assert _close(step(device=CPU, chunk=300), whole)
    assert len(searched) == 2 * 7, "seven chunks, two surfaces, and none again in the backward pass"


@pytest.mark.parametrize("device", DEVICES)
def test_the_same_rays_give_the_same_bits_on_the_same_device(device: str) -> None:
    step, where = _Step({}), torch.device(device)
    assert all(torch.equal(a, b) for a, b in zip(step(device=where), step(device=where), strict=True))


@pytest.mark.parametrize("device", DEVICES)
def test_a_design_ends_where_the_kernels_end(device: str) -> None:
    spec = small_spec()
    source = build_source(spec.source)
    kernels, found = (search(spec, source, accuracy="draft", device=d) for d in (None, torch.device(device)))
    for one, other in zip(found.history, kernels.history, strict=True):
        assert one.loss == pytest.approx(other.loss, rel=1e-8)
    assert np.allclose(found.lens.outer.weights_mm, kernels.lens.outer.weights_mm, rtol=1e-6, atol=1e-9)


def test_a_checkpoint_is_not_resumed_on_another_device(tmp_path: Path) -> None:
    spec = small_spec(optimise__steps_per_level=[2, 2])
    source = build_source(spec.source)
    search(spec, source, accuracy="draft", checkpoint=tmp_path / FILE_NAME, device=CPU)
    search(spec, source, accuracy="draft", checkpoint=tmp_path / FILE_NAME, device=CPU, resume=True)
    with pytest.raises(InputError, match="start or device"):
        search(spec, source, accuracy="draft", checkpoint=tmp_path / FILE_NAME, resume=True)
