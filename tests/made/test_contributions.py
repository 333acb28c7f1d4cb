"""Shares of a variance, of functions whose shares are known in closed form."""

import numpy as np
import pytest
from scenes import part_tolerances

from lensforge.made.yield_study import contributions, features
from lensforge.scene.perturbations import Draws
from lensforge.spec.tolerances_section import factors_of


def _draws(parts: int, seed: int = 0, distribution: str = "uniform", **amounts: float) -> Draws:
    spread = {
        name: amount if name.endswith("_um") else {"amount": amount, "distribution": distribution}
        for name, amount in amounts.items()
    }
    return Draws.of(factors_of(part_tolerances(**spread)), parts, seed)


def _shares(draws: Draws, values: np.ndarray, noise: float = 0.0) -> dict:
    result = contributions(draws, values, noise)
    assert sum(cause.share for cause in result.causes) + result.interactions.value == pytest.approx(1.0)
    shares = {cause.tolerance: (cause.share, cause.standard_error) for cause in result.causes}
    return {**shares, "together": (result.interactions.value, result.interactions.standard_error)}


def _agree(shares: dict, truth: dict) -> None:
    for name, share in truth.items():
        value, error = shares[name]
        assert abs(value - share) < 4.0 * error + 0.01, name
        assert error < 0.06


def test_shares_of_the_ishigami_function() -> None:
    """Ishigami and Homma (1990), with a = 7, b = 0.1: shares 0.3139, 0.4424, 0, and 0.2437 of the first and third."""
    draws = _draws(4000, gap_mm=1.0, index=0.1, shrinkage=0.1)
    x, y, z = (np.pi * draws.numbers[name][:, 0] for name in ("gap_mm", "index", "shrinkage"))
    values = np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)
    shares = _shares(draws, values)
    # sin^2 over a whole period is a polynomial of degree 4 to a quarter of its variance
    assert shares["gap_mm"][0] == pytest.approx(0.3139, abs=0.04)
    assert shares["shrinkage"][0] == pytest.approx(0.0, abs=0.02)
    assert shares["together"][0] > 0.2


def test_shares_of_a_sum_and_a_product() -> None:
    draws = _draws(2000, distribution="normal", gap_mm=1.0, index=0.1, shrinkage=0.1)
    x, y, z = (2.0 * draws.numbers[name][:, 0] for name in ("gap_mm", "index", "shrinkage"))
    shares = _shares(draws, 3.0 + 2.0 * x + y**2 + np.sqrt(3.0) * x * z)
    _agree(shares, {"gap_mm": 4.0 / 9.0, "index": 2.0 / 9.0, "shrinkage": 0.0, "together": 3.0 / 9.0})


def test_a_shift_in_x_and_y_is_one_cause() -> None:
    draws = _draws(2000, outer_shift_mm=0.1, gap_mm=0.1)
    x, y = draws.numbers["outer_shift_mm"].T * np.sqrt(3.0)
    _agree(_shares(draws, x * y), {"outer_shift_mm": 1.0, "gap_mm": 0.0})


def test_a_form_error_is_one_cause_with_all_products_of_its_numbers() -> None:
    """y = z'A z + b'z of 32 normal numbers: variance 2 |A|^2 + |b|^2."""
    draws = _draws(2000, inner_waviness_um=1.0, inner_form_um=1.0, gap_mm=0.1)
    rng = np.random.default_rng(1)
    a = rng.normal(size=(32, 32))
    b = rng.normal(size=9)
    a = (a + a.T) / np.sqrt(8.0 * 32.0)
    b = b / np.linalg.norm(b) * 8.0
    z, w = draws.numbers["inner_waviness_um"], draws.numbers["inner_form_um"]
    values = np.einsum("ni,ij,nj->n", z, a, z) + w @ b
    of_waviness = 2.0 * np.sum(a**2)
    of_form = 64.0
    total = of_waviness + of_form
    _agree(
        _shares(draws, values),
        {"inner_waviness_um": of_waviness / total, "inner_form_um": of_form / total, "gap_mm": 0.0},
    )


def test_what_is_certain_leads_and_not_what_is_large() -> None:
    """The hundreds of functions of a waviness without effect explain 16 % of 200 parts or more, by chance."""
    by_value = 0
    for seed in range(40):
        draws = _draws(200, seed, inner_waviness_um=1.0, gap_mm=0.1, index=0.1)
        gap = np.sqrt(3.0) * draws.numbers["gap_mm"][:, 0]
        noise = np.random.default_rng(seed).normal(size=200)
        causes = contributions(draws, np.sqrt(0.2) * gap + np.sqrt(0.8) * noise, 0.0).causes
        by_value += max(causes, key=lambda cause: cause.share).tolerance == "inner_waviness_um"
        sure = [max(cause.share - 2.0 * cause.standard_error, 0.0) for cause in causes]
        assert sure == sorted(sure, reverse=True)
        assert causes[0].tolerance == "gap_mm" or sure[0] == 0.0 or causes[0].share > 0.3
    assert by_value > 2, "the seeds tell the two orders apart"


def test_noise_of_rays_is_nobodys() -> None:
    draws = _draws(2000, gap_mm=0.1)
    signal = np.sqrt(3.0) * draws.numbers["gap_mm"][:, 0]
    noise = np.random.default_rng(0).normal(size=2000)
    assert _shares(draws, signal + noise, 1.0)["gap_mm"][0] == pytest.approx(1.0, abs=0.12)


def test_shares_have_no_bias_and_true_errors() -> None:
    """Without any cause, over 100 seeds: their mean is 0, and they scatter as their errors say."""
    estimates = []
    for seed in range(100):
        draws = _draws(400, seed, inner_waviness_um=1.0)
        estimates.append(_shares(draws, np.random.default_rng(seed).normal(size=400))["inner_waviness_um"])
    shares, errors = np.array(estimates).T
    assert abs(shares.mean()) < 4.0 * shares.std() / 10.0
    assert 0.6 < shares.std() / errors.mean() < 1.4


def test_features_are_orthonormal() -> None:
    draws = _draws(40_000, outer_shift_mm=0.1, inner_form_um=1.0)
    for factor in draws.factors:
        columns = features(factor, draws.numbers[factor.name])
        products = columns.T @ columns / len(columns)
        assert np.abs(products - np.eye(len(products))).max() < 0.12
        assert np.abs(columns.mean(axis=0)).max() < 0.03
