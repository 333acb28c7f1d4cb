"""A search for the share of the parts that hold their limits: what the share means, its gradient, and what it gains."""

from typing import Any

import numpy as np
import pytest
import torch
from scenes import NO_TOLERANCES, small_spec, tolerance_changes
from scipy.special import log_ndtr
from scipy.stats import norm
from search_scenes import LARGE, Step

from lensforge.errors import InputError
from lensforge.made.tolerance_result import PASS_RATE
from lensforge.made.yield_study import measure_yield
from lensforge.search.optimiser import search
from lensforge.search.share_of_parts import deviations_beyond, share_term
from lensforge.sources.build_source import build_source

SQUARE = {"kind": "rectangle", "width_mm": 120.0, "height_mm": 120.0}
FLUX = {"kind": "zone", "zone": SQUARE, "at_least_share": 0.05}
EVEN = {"kind": "zone", "zone": SQUARE, "at_least_min_over_mean": 0.7}


def parts_of(means: list[float], spreads: list[float], parts: int, seed: int) -> list[torch.Tensor]:
    """Excess of pairs of opposite parts over one limit each, whose readings are normal and independent."""
    rng = np.random.default_rng(seed)
    numbers = rng.standard_normal((parts // 2, 1, len(means))) * np.array([[1.0], [-1.0]])
    excess = np.array(means) + np.array(spreads) * numbers.reshape(parts, len(means))
    return list(torch.from_numpy(excess).T[..., None])


@pytest.mark.parametrize(("spreads", "apart"), [([0.03], [0.0]), ([0.03, 0.2], [0.0, 0.01])], ids=["one", "two"])
def test_of_other_parts_as_many_hold_their_limits_as_the_share_says(spreads: list[float], apart: list[float]) -> None:
    """The lens that is pulled in until the term is 0, and no further."""

    def at(inside: float) -> list[float]:
        return [other - inside for other in apart]

    def term(inside: float) -> float:
        return share_term(parts_of(at(inside), spreads, 2**12, 1), [0.0] * len(spreads), 0.95).item()

    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if term(middle) == 0.0 else (middle, high)
    others = torch.cat(parts_of(at(high), spreads, 2**17, 2), dim=1)
    assert float((others <= 0.0).all(dim=1).double().mean()) == pytest.approx(0.95, abs=0.004)


def test_a_slope_is_left_where_no_part_passes_and_none_where_all_do() -> None:
    for inside, slope in ((-5.0, True), (-0.03, True), (2.0, False)):
        moved = torch.tensor([-inside, -inside], dtype=torch.float64, requires_grad=True)
        beyond = deviations_beyond([moved + torch.tensor([[0.03, -0.01], [-0.03, 0.01]])], [0.02])
        (gradient,) = torch.autograd.grad(beyond, moved)
        assert torch.isfinite(beyond) and torch.isfinite(gradient).all() and bool((gradient > 0.0).all()) == slope
    far = deviations_beyond([5.0 + torch.tensor([[0.03, 0.03], [-0.03, -0.03]], dtype=torch.float64)], [0.02])
    assert far.item() == pytest.approx(np.sqrt(2.0) * 5.0 / np.hypot(0.03, 0.02), rel=1e-3), (
        "the root of the sum of u^2"
    )


class ShareStep(Step):
    """A step from a crooked lens, and the term of its limits alone."""

    def __init__(self, *limits: dict[str, Any]) -> None:
        super().__init__({"optimise__robust": 0.9, "limits": list(limits), **tolerance_changes(LARGE)})

    def term(self, by: float = 0.0) -> torch.Tensor:
        """The part of the merit that the limits make, with the weights moved."""
        merit = self.problem.merit
        tables = merit.parametrisation.tables(self.parameters[0] + by * self.ways[0], self.parameters[1])
        return merit._limit_term(merit.light_of(tables, self.rays, self.pairs))


def by_hand(step: ShareStep) -> float:
    """The term by the formulas of docs/definitions.md, section 16, from the pictures of the parts."""
    merit = step.problem.merit
    light, logarithm = merit.light_of(merit.parametrisation.tables(*step.parameters), step.rays, step.pairs), 0.0
    assert len(light.pairs) == 4
    for limit in merit.limits:
        images = [light.images[0] + sign * pair.images[0] for pair in light.pairs for sign in (1.0, -1.0)]
        excess = np.array([limit.excesses((image,))[0].numpy() for image in images])
        u = excess.mean(axis=0) / np.sqrt(excess.var(axis=0) + 0.02**2)
        logarithm += float(log_ndtr(-u).sum())
    missing = max(norm.ppf(0.9) - norm.ppf(np.exp(logarithm)), 0.0)
    return missing**2 / (1.0 + missing)


def test_the_second_of_two_limits_decides_and_the_gradient_is_that_of_differences() -> None:
    both, second, step = ShareStep(FLUX, EVEN), ShareStep(EVEN), 1e-8
    with torch.no_grad():
        value = both.term().item()
        assert value > 0.01 and value == pytest.approx(second.term().item(), rel=1e-6)
        change = (both.term(step) - both.term(-step)).item() / (2.0 * step)
        assert value == pytest.approx(by_hand(both), rel=1e-9)
    (gradient,) = torch.autograd.grad(both.term(), both.parameters[0])
    assert abs(change) > 1e-3 and change == pytest.approx((gradient * both.ways[0]).sum().item(), rel=2e-4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"optimise__robust": "yield"}, "asks for parts that hold limits, and there are none"),
        ({"optimise__robust": 1.0, "limits": [EVEN]}, "robust = 1.0: must be true, false"),
        ({"optimise__robust": 0.9991, "limits": [EVEN]}, "robust = 0.9991: must be true, false"),
        ({"optimise__robust": 0.4999, "limits": [EVEN]}, "robust = 0.4999: must be true, false"),
        ({"optimise__robust": "most", "limits": [EVEN]}, "robust = 'most': must be true, false"),
    ],
    ids=["no limits", "all parts", "nearly all parts", "less than half", "no share"],
)
def test_a_share_that_no_search_can_have_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        small_spec(**changes)
    assert "\n" not in str(error.value)


def test_a_yield_is_the_share_that_a_budget_asks_for() -> None:
    given = (True, "yield", 0.8, 0.5, 0.999)  # the last two are the least and the most
    shares = [small_spec(optimise__robust=robust, limits=[EVEN]).optimise.share for robust in given]
    assert shares == [None, PASS_RATE, 0.8, 0.5, 0.999]


@pytest.mark.nightly("two searches of 260 steps")
def test_more_of_other_parts_hold_the_limits_than_of_a_plain_search() -> None:
    """Of two limits in conflict, by rays and parts that no search has seen."""
    passing = []
    wide = {"kind": "rectangle", "width_mm": 150.0, "height_mm": 150.0}
    bright = {"kind": "points", "at_mm": [[60, 60], [-60, 60]], "unit": "relative", "at_least": 0.5}
    changes = {"optimise__steps_per_level": [60, 200], "optimise__rays": 4096}
    changes |= {"tolerances": {"source_shift_mm": 0.4, "lens_shift_mm": 0.3}}
    changes |= {"limits": [{"kind": "zone", "zone": wide, "at_least_share": 0.62}, bright]}
    for robust in (False, "yield"):
        spec = small_spec(optimise__robust=robust, **changes)
        lens = search(spec, build_source(spec.source), accuracy="draft").lens
        passing.append(measure_yield(lens, parts=128, rays=2**14, with_budget=False).pass_rate)
    assert passing[1].low > passing[0].high


def test_tolerances_that_are_all_0_or_wider_than_the_lens_are_refused() -> None:
    for amounts, message in (
        ({}, "all of them are 0"),
        ({"source_shift_mm": 4.0}, r"source_shift_mm = 4: .* at most 1\."),
    ):
        spec = small_spec(optimise__robust="yield", limits=[EVEN], **tolerance_changes(NO_TOLERANCES | amounts))
        with pytest.raises(InputError, match=message):
            search(spec, build_source(spec.source), accuracy="draft")
