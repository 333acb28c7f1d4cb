"""The merit of a step written out in numpy: wanted light, error of the image, even light in a region, flux and losses.

Images and sums of the rays are taken as they are collected: these have tests of their own.
"""

from typing import Any

import numpy as np
import pytest
import torch
from scenes import small_spec
from search_scenes import RECEIVERS

from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.merit import MeritFunction
from lensforge.search.parameters import SphereParameters
from lensforge.sources.build_source import SquareEmitter, build_source

SIDE = 60.0
PIXELS = 16
REGION = 32.0
N = 1.5
ROUGHNESS = {"square": 0.8, "none": 0.3}  # of the outer face: some light is reflected totally
TARGETS = {"square": {"width_mm": 40.0, "uniform_mm": REGION}, "none": {"width_mm": 40.0, "uniform_mm": None}}


def _spec(symmetry: str, fresnel: bool) -> Any:
    target = {"kind": "flat_top", "distance_mm": 40.0, "receiver_mm": SIDE, **TARGETS[symmetry]}
    lens = {"levels": [9, 25], "inner": {"offset_mm": 3.0}, "outer": {"offset_mm": 6.0}, "symmetry": symmetry}
    lens |= {"refractive_index": N, "material": "glass"}
    return small_spec(target=target, lens=lens, optimise__fresnel=fresnel, optimise__pixels=PIXELS)


def _mirrored(image: np.ndarray, symmetry: str) -> np.ndarray:
    """Mean over the eight mirror images of a square, or the image itself."""
    if symmetry == "none":
        return image
    half = 0.5 * (image + image[::-1])
    half = 0.5 * (half + half[:, ::-1])
    return 0.5 * (half + half.T)


def _smoothed(image: np.ndarray) -> np.ndarray:
    """Mean of each pixel and its neighbours by a Gaussian of one pixel; those of the edge are repeated outwards."""
    padded = np.pad(image, 1, mode="edge")
    total = np.zeros_like(image)
    weight = 0.0
    for row in range(3):
        for column in range(3):
            share = np.exp(-0.5 * ((row - 1) ** 2 + (column - 1) ** 2))
            total += share * padded[row : row + len(image), column : column + len(image)]
            weight += share
    return total / weight


def _wanted(merit: MeritFunction, flux_w: float, fresnel: bool) -> np.ndarray:
    """The flat top on each pixel, with the flux that two faces transmit at normal incidence."""
    fine = (np.arange(64 * PIXELS) + 0.5) * SIDE / (64 * PIXELS) - 0.5 * SIDE
    exponent = merit.spec.target.exponent
    along = np.exp(-(np.abs(fine / 20.0) ** exponent)).reshape(PIXELS, 64).mean(axis=1)
    light = np.outer(along, along)
    once = 4.0 * N / (N + 1.0) ** 2 if fresnel else 1.0
    return light / light.sum() * once**2 * flux_w


@pytest.mark.parametrize("fresnel", [True, False])
@pytest.mark.parametrize("uniform", [True, False])
@pytest.mark.parametrize("symmetry", ["square", "none"])
def test_the_merit_is_the_sum_of_its_terms(symmetry: str, uniform: bool, fresnel: bool) -> None:
    spec = _spec(symmetry, fresnel)
    source = build_source(spec.source)
    parametrisation = SphereParameters.of(spec, 4.0)
    merit = MeritFunction.of(spec, source, parametrisation)
    scale = np.array([0.1, 1.0]) * ROUGHNESS[symmetry]
    weights = torch.from_numpy(np.random.default_rng(0).normal(size=(parametrisation.basis.size, 2)) * scale)
    offsets = torch.ones(2, dtype=torch.float64)
    rays = source.sample(4096, 1)
    constraints = AugmentedLagrangian.of(spec, parametrisation.grid)
    step = merit.step_loss(weights, offsets, rays, constraints, uniform)
    (light,) = merit.light.collect(parametrisation.tables(weights, offsets), rays)
    image = _mirrored(light.image.numpy(), symmetry)
    wanted = _wanted(merit, 1.0, fresnel)
    in_window, outside, reflected = (
        tensor.item() for tensor in (light.in_window, light.outside_receiver, light.total_reflection)
    )
    assert min(in_window, outside, reflected) > 1e-3, "every term counts"
    nmse = np.sum((image - wanted) ** 2) / np.sum(wanted**2)
    assert step.nmse == pytest.approx(nmse, rel=1e-5)
    assert step.efficiency == pytest.approx(image.sum(), rel=1e-12)
    expected = nmse + 0.3 * outside - 0.15 * in_window + 0.3 * reflected
    if symmetry == "square":  # it has a region of uniform light
        expected = nmse + 0.3 * outside - 1.2 * in_window + 0.1 * reflected
        # all pixels that the region meets, in part or whole
        meets = np.abs((np.arange(PIXELS) + 0.5) * SIDE / PIXELS - 0.5 * SIDE) <= 0.5 * (REGION + SIDE / PIXELS)
        mask = np.outer(meets, meets)
        even = image[mask] / image[mask].mean()
        smooth = _smoothed(image)[mask]
        shortfall = np.maximum(0.97 - smooth / smooth.mean(), 0.0)
        if uniform:
            expected += 10.0 * np.mean((even - 1.0) ** 2) + 300.0 * np.mean(shortfall**2)
    term = constraints.term(step.fields).item()
    assert step.loss.item() - term == pytest.approx(expected, abs=2e-5), "pixels of 64 x 64 points"


@pytest.mark.parametrize("fresnel", [True, False])
def test_the_wanted_light_is_that_of_the_source_less_what_both_faces_reflect_at_least(fresnel: bool) -> None:
    spec = small_spec(target=None, receivers=[RECEIVERS["sphere"]], optimise__fresnel=fresnel)
    merit = MeritFunction.of(spec, SquareEmitter(1.0, flux_w=2.5), SphereParameters.of(spec, 4.0))
    index = spec.lens.refractive_index
    passed = (4.0 * index / (index + 1.0) ** 2) ** 2 if fresnel else 1.0  # Born and Wolf, 1.5.3
    assert merit.terms[0].wanted.sum().item() == pytest.approx(2.5 * passed, rel=1e-12)
