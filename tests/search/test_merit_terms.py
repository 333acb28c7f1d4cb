"""Terms of pictures and limits in the merit of a search: sums over pixels and places, closed forms, two pictures."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from scenes import small_spec
from scipy import sparse

from lensforge.scene.limit_readings import LightLimit
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.search.image_terms import ImageTerms, nmse_loss, shortfall_loss, uniformity_loss
from lensforge.search.limit_terms import LimitTerm
from lensforge.search.parameters import chart_mirrors, mirror_mean, mirrored_light
from lensforge.spec.quantities import (
    BeamAngle,
    FluxShare,
    LeastOverMean,
    LeastOverMost,
    PlaceLight,
    Quantity,
    RelativeLight,
    not_dark,
)

CHANCE = np.random.default_rng(0)
MASK = torch.zeros((3, 4), dtype=torch.bool)
MASK[1:, 1:3] = True


def tensor(values: Any) -> torch.Tensor:
    return torch.from_numpy(np.asarray(values, dtype=np.float64))


def smooth(image: np.ndarray) -> np.ndarray:
    padded = np.pad(image, 1, mode="edge")
    weights = np.exp(-0.5 * np.add.outer(*2 * (np.array([1.0, 0.0, 1.0]),)))
    rows = [
        [np.sum(weights * padded[r : r + 3, c : c + 3]) for c in range(image.shape[1])] for r in range(image.shape[0])
    ]
    return np.array(rows) / weights.sum()


PICTURE = np.linspace(0.2, 1.6, 12).reshape(3, 4)[:, ::-1] * CHANCE.uniform(0.9, 1.1, (3, 4))
READ = CHANCE.uniform(0.0, 1.0, (5, 12))


QUANTITIES: dict[str, Quantity] = {
    "light": PlaceLight(), "share": FluxShare(), "relative": RelativeLight(), "min_over_mean": LeastOverMean(),
    "min_over_max": LeastOverMost(),
}  # fmt: skip


def term(quantity: str, sense: str, bound: float, rows: int = 5, level: float = 1.0) -> LimitTerm:
    kinds = {**QUANTITIES, "beam_angle": BeamAngle(np.array([-8.0, -4.0, 0.0, 4.0, 8.0])[:rows], level)}
    readings = sparse.csr_array(READ[:rows])
    return LimitTerm.of(LightLimit("a", 0, kinds[quantity], sense, "lx", readings, bound))  # type: ignore[arg-type]


@pytest.mark.parametrize("sense", [">=", "<="])
@pytest.mark.parametrize("quantity", ["light", "share", "relative", "min_over_mean", "min_over_max", "beam_angle"])
@pytest.mark.parametrize("dark", [False, True])
def test_the_cost_of_a_limit_is_a_mean_over_its_places(quantity: str, sense: str, dark: bool) -> None:
    picture = np.zeros((3, 4)) if dark else PICTURE
    even = smooth(picture)
    bounds = {
        "light": 4.5,
        "share": 4.5,
        "beam_angle": 20.0 if sense == ">=" else 8.0,
        "relative": 0.6 if sense == ">=" else 0.3,
    }
    light = READ @ even.ravel()
    bound = bounds.get(quantity, 0.9)
    level = 0.8
    scale = {
        "relative": even.max() * READ.sum(axis=1).max(), "min_over_mean": light.mean(), "min_over_max": light.max(),
        "beam_angle": light.max(),
    }.get(quantity, 1.0) or 1.0  # fmt: skip
    total = 0.0
    for place, angle in zip(light, (-8.0, -4.0, 0.0, 4.0, 8.0), strict=True):
        relative = place / (scale * (level if quantity == "beam_angle" else bound))
        excess = max(1.03 - relative if sense == ">=" else relative - 0.97, 0.0)
        off = abs(angle) - 0.5 * bound
        if quantity == "beam_angle" and not (off < 0.0 if sense == ">=" else off > 0.0):
            excess = 0.0
        total += excess**2 / (1.0 + excess)
    cost = (
        term(quantity, sense, bound, level=level if quantity == "beam_angle" else 1.0).loss((tensor(picture),)).item()
    )
    assert cost == pytest.approx(150.0 * total / 5.0, rel=1e-12)
    assert cost > 0.0 or (dark and sense == "<=")


def test_losses_of_a_dim_picture_are_sums_over_its_pixels() -> None:
    image = 0.01 * PICTURE
    wanted = np.full((3, 4), 0.012)
    apart = sum((a - b) ** 2 for a, b in zip(image.flat, wanted.flat, strict=True))
    assert nmse_loss(tensor(image), tensor(wanted)).item() == pytest.approx(apart / (12 * 0.012**2))
    inside = image[MASK.numpy()]
    uneven = sum((pixel / inside.mean() - 1.0) ** 2 for pixel in inside) / 4.0
    assert uniformity_loss(tensor(image), MASK).item() == pytest.approx(uneven)
    even = smooth(image)[MASK.numpy()]
    missing = [max(0.95 - pixel / even.mean(), 0.0) for pixel in even]
    short = sum(lack**2 for lack in missing) / 4.0
    assert shortfall_loss(tensor(image), MASK, 0.05).item() == pytest.approx(short) and short > 0.0
    terms = ImageTerms(tensor(wanted), MASK, (), 0.5)
    in_full = sum(max(0.97 - pixel / even.mean(), 0.0) ** 2 for pixel in even) / 4.0
    nmse = apart / (12 * 0.012**2)
    assert terms.loss(tensor(image), False).item() == pytest.approx(nmse)
    assert terms.loss(tensor(image), True).item() == pytest.approx(nmse + 10.0 * uneven + 300.0 * in_full)
    assert replace(terms, mask=None).loss(tensor(image), True).item() == pytest.approx(nmse)


def test_a_dark_picture_is_as_bad_as_one_whose_scale_is_1() -> None:
    dark = tensor(np.zeros((3, 4)))
    assert (
        not_dark(tensor(0.0)).item() == not_dark(tensor(-2.0)).item() == 1.0 and not_dark(tensor(0.01)).item() == 0.01
    )
    assert uniformity_loss(dark, MASK).item() == 1.0
    assert shortfall_loss(dark, MASK, 0.05).item() == pytest.approx(0.95**2)


def test_two_pictures_are_judged_by_the_product_of_their_errors() -> None:
    first = PICTURE
    second = PICTURE[::-1].copy()
    wanted = np.ones((3, 4))
    terms = ImageTerms(tensor(wanted), MASK, (), 1.0)
    product = np.sum((first - wanted) * (second - wanted)) / 12.0
    assert terms.judge(tensor(first), tensor(second), False).item() == pytest.approx(product)
    ones = first[MASK.numpy()]
    others = second[MASK.numpy()]
    uneven = np.mean((ones / ones.mean() - 1.0) * (others / others.mean() - 1.0))
    short = shortfall_loss(tensor(0.5 * (first + second)), MASK, 0.03).item()
    judged = terms.judge(tensor(first), tensor(second), True).item()
    assert judged == pytest.approx(product + 10.0 * uneven + 300.0 * short)


@pytest.mark.parametrize("symmetry", ["none", "mirror_x", "square"])
def test_the_wanted_light_its_mask_and_its_mirrors_are_those_of_the_scene(symmetry: str) -> None:
    spec = small_spec(lens__symmetry=symmetry)
    (receiver,) = receivers_of(spec, 10)
    (section,) = spec.all_receivers
    terms = ImageTerms.of(section.targets, receiver, 2.5, symmetry, 0.75)
    np.testing.assert_allclose(terms.wanted.numpy(), 2.5 * target_light(section.targets, receiver))
    centres = np.abs(receiver.grid.x()) <= 0.5 * (100.0 + 20.0)  # half a pixel of 20 mm more on each side
    assert terms.mask is not None and np.array_equal(terms.mask.numpy(), np.outer(centres, centres))
    assert terms.mirrors == chart_mirrors(receiver, symmetry) and terms.share == 0.75
    image = tensor(CHANCE.random((10, 10)))
    assert torch.equal(terms.mirrored(image), mirrored_light(image, terms.mirrors))
    wanted = mirror_mean(image.T, symmetry).T
    assert torch.allclose(terms.mirrored(image), wanted, atol=1e-15)


BRIGHT = torch.from_numpy(np.random.default_rng(0).uniform(0.5, 1.5, (6, 7)))
INSIDE = torch.zeros((6, 7), dtype=torch.bool)
INSIDE[1:4, 2:6] = True


def test_noise_that_differs_between_two_pictures_leaves_the_mean_of_their_judgements() -> None:
    """Two signs of noise in either picture: all four pairs have on average the error of the picture without noise."""
    image = 1.2 * BRIGHT
    noise = 0.1 * torch.from_numpy(np.random.default_rng(2).normal(size=BRIGHT.shape))
    both = (image + noise, image - noise)
    judged = [ImageTerms(BRIGHT, None, (), 1.0).judge(one, other, False).item() for one in both for other in both]
    assert np.mean(judged) == pytest.approx(0.2**2)
    assert judged[1] < 0.2**2 < max(judged)
