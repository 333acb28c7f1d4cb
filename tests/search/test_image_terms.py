"""Terms of the light on one receiver against closed forms, and a judgement by two pictures against the loss by one."""

import numpy as np
import pytest
import torch

from lensforge.search.light_path import Collected
from lensforge.search.merit_terms import ImageTerms, shortfall_loss, smoothed

WANTED = torch.from_numpy(np.random.default_rng(0).uniform(0.5, 1.5, (6, 7)))
MASK = torch.zeros((6, 7), dtype=torch.bool)
MASK[1:4, 2:6] = True


def terms(mask: torch.Tensor | None = MASK) -> ImageTerms:
    return ImageTerms(WANTED, mask, (), 1.0)


def test_a_lit_pixel_is_smoothed_to_a_gaussian_of_variance_one_and_even_light_stays_even() -> None:
    image = torch.zeros((5, 6), dtype=torch.float64)
    image[2, 3] = 1.0
    row, column = np.mgrid[:5, :6]
    weights = np.exp(-0.5 * ((row - 2.0) ** 2 + (column - 3.0) ** 2)) * (np.maximum(abs(row - 2), abs(column - 3)) < 2)
    np.testing.assert_allclose(smoothed(image).numpy(), weights / weights.sum(), atol=1e-15)
    np.testing.assert_allclose(smoothed(torch.full((5, 6), 0.7, dtype=torch.float64)).numpy(), 0.7, rtol=1e-14)


def test_the_shortfall_is_that_below_the_margin() -> None:
    """A slope is smoothed to itself: pixels at 0.7 to 1.3 of the mean fall short of 0.95 by 0.25 and 0.05."""
    slope = torch.tensor([0.7, 0.9, 1.1, 1.3], dtype=torch.float64).repeat(9, 1)
    slope = torch.nn.functional.pad(slope, (1, 1))
    slope[:, 0], slope[:, -1] = 0.5, 1.5
    mask = torch.zeros((9, 6), dtype=torch.bool)
    mask[:, 1:-1] = True
    expected = (0.25**2 + 0.05**2) / 4.0
    assert shortfall_loss(3.0 * slope, mask, 0.05).item() == pytest.approx(expected)


@pytest.mark.parametrize("uniform", [True, False])
@pytest.mark.parametrize("mask", [MASK, None])
def test_two_equal_pictures_are_judged_as_the_loss_of_one(mask: torch.Tensor | None, uniform: bool) -> None:
    image = torch.from_numpy(np.random.default_rng(1).uniform(0.2, 1.8, WANTED.shape))
    made = terms(mask)
    assert made.judge(image, image, uniform).item() == pytest.approx(made.loss(image, uniform).item(), rel=1e-13)


def test_noise_that_differs_between_two_pictures_leaves_the_mean_of_their_judgements() -> None:
    """Two signs of noise in either picture: all four pairs have on average the error of the picture without noise."""
    image, noise = 1.2 * WANTED, 0.1 * torch.from_numpy(np.random.default_rng(2).normal(size=WANTED.shape))
    both = (image + noise, image - noise)
    judged = [terms().judge(one, other, False).item() for one in both for other in both]
    assert np.mean(judged) == pytest.approx(0.2**2)
    assert judged[1] < 0.2**2 < max(judged)


def test_light_in_the_window_lowers_the_term_and_light_beside_the_receiver_raises_it() -> None:
    def term(mask: torch.Tensor | None, **flux: float) -> float:
        names = ("in_window", "outside_receiver", "total_reflection")
        sums = {name: torch.tensor(flux.get(name, 0.0), dtype=torch.float64) for name in names}
        return terms(mask).flux_term(Collected(WANTED, **sums)).item()

    for mask in (MASK, None):
        assert term(mask, in_window=1.0) < 0.0 < term(mask, outside_receiver=1.0)
        both = term(mask, in_window=1.0) + 2.0 * term(mask, outside_receiver=1.0)
        assert term(mask, in_window=1.0, outside_receiver=2.0) == pytest.approx(both)
    assert term(MASK, in_window=1.0) < term(None, in_window=1.0), "with a mask efficiency is asked for by this alone"
