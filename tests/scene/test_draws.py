"""Parts drawn from tolerances: distributions, independence, and the polynomials that are orthonormal over them."""

import numpy as np
import pytest
from scenes import part_tolerances
from scipy.stats import kstest, norm, truncnorm, uniform

from lensforge.errors import InputError
from lensforge.scene.perturbations import Draws, orthonormal, quantiles
from lensforge.spec.tolerances_section import (
    FaceTolerances,
    Factor,
    PartTolerances,
    TolerancesSection,
    factors_of,
    read_tolerances,
)

TRUTHS = {"uniform": uniform(-1.0, 2.0), "normal": norm(0.0, 0.5), "truncated": truncnorm(-2.0, 2.0, 0.0, 0.5)}


def _factor(distribution: str, kind: str = "spread") -> Factor:
    return Factor("gap_mm", "gap", "mm", 1.0, 0.1, kind, distribution, 1)


@pytest.mark.parametrize("distribution", TRUTHS)
def test_numbers_have_their_distribution(distribution: str) -> None:
    levels = np.random.default_rng(0).random(4000)
    assert kstest(quantiles(_factor(distribution), levels), TRUTHS[distribution].cdf).pvalue > 1e-3
    one_sided = quantiles(_factor(distribution, "one-sided"), levels)
    assert kstest(one_sided, lambda x: TRUTHS[distribution].cdf(x) - TRUTHS[distribution].cdf(-x)).pvalue > 1e-3
    assert one_sided.min() >= 0.0


@pytest.mark.parametrize("kind", ["spread", "one-sided"])
@pytest.mark.parametrize("distribution", TRUTHS)
def test_polynomials_are_orthonormal_over_the_parts(distribution: str, kind: str) -> None:
    factor = _factor(distribution, kind)
    low = 0.0 if kind == "one-sided" else -5.0
    values = low + (5.0 - low) * (np.arange(200_000) + 0.5) / 200_000
    shares = TRUTHS[distribution].pdf(values)
    basis = np.column_stack([np.ones(len(values)), orthonormal(factor, values, 4)])
    assert np.allclose((basis.T * shares) @ basis / shares.sum(), np.eye(5), atol=1e-3)


def test_a_tolerance_has_its_amount_in_the_unit_of_its_name() -> None:
    factors = factors_of(part_tolerances(gap_mm=0.3, outer_tilt_deg={"amount": 2.0, "distribution": "uniform"}))
    assert [factor.name for factor in factors] == ["gap_mm", "outer_tilt_deg"]
    draws = Draws.of(factors, 512, 0)
    gap = np.array([draws.deviations(part)["gap_mm"][0] for part in range(512)])
    tilt = np.array([draws.deviations(part)["outer_tilt_deg"] for part in range(512)])
    assert np.abs(gap).max() == pytest.approx(0.3, rel=0.03)
    assert gap.std() == pytest.approx(0.3 * TRUTHS["truncated"].std(), rel=0.01)
    assert tilt.shape == (512, 2)
    assert tilt.std(axis=0) == pytest.approx(np.full(2, np.radians(2.0) / np.sqrt(3.0)), rel=0.01)
    assert abs(np.corrcoef(tilt.T)[0, 1]) < 0.05
    twice = draws.deviations(7, {"gap_mm": 2.0})
    assert twice["gap_mm"] == 2.0 * draws.deviations(7)["gap_mm"]
    assert (twice["outer_tilt_deg"] == draws.deviations(7)["outer_tilt_deg"]).all()


def test_parts_are_the_first_of_an_endless_row_and_other_seeds_give_others() -> None:
    factors = factors_of(PartTolerances())
    few = Draws.of(factors, 100, 3)
    many = Draws.of(factors, 1000, 3)
    other = Draws.of(factors, 100, 4)
    for name, numbers in few.numbers.items():
        assert (numbers == many.numbers[name][:100]).all()
        assert not (numbers == other.numbers[name]).any()


def test_fields_do_not_depend_on_other_tolerances() -> None:
    every = Draws.of(factors_of(PartTolerances()), 10, 0).numbers["outer_form_um"]
    alone = Draws.of(factors_of(part_tolerances(outer_form_um=1.0)), 10, 0).numbers["outer_form_um"]
    assert (every == alone).all()


def test_mirrored_parts_are_the_opposite_but_for_roughness() -> None:
    draws = Draws.of(factors_of(PartTolerances()), 10, 0)
    other = draws.mirrored()
    for factor in draws.factors:
        sign = 1.0 if factor.kind == "one-sided" else -1.0
        assert (other.numbers[factor.name] == sign * draws.numbers[factor.name]).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"faces": {"outer": {"gap_mm": {"amount": 0, "distribution": "normal"}}}}, "a distribution has a width"),
        ({"faces": {"outer": {"gap_mm": {"distribution": "normal"}}}}, "outer.gap_mm.amount: missing"),
        ({"faces": {"outer": {"gap_mm": 9.0}}}, "outer: gap_mm = 9: must be at most 5"),
        ({"faces": {"outer": {"gap_mm": "wide"}}}, "must be a number, or a table"),
        ({"faces": {"inner": {"form_um": {"amount": 1.0, "distribution": "normal"}}}}, "leave out distribution"),
        (
            {"faces": {"inner": {"tilt_deg": 1.0}}},
            "inner.tilt_deg: this face is what the next is placed against; give outer.tilt",
        ),
        ({"gap_mm": 0.1}, "gap_mm = 0.1: unknown; it is lens.outer.gap_mm now"),
        ({"waviness_shortest_mm": 8.0}, "must be below waviness_longest_mm = 5"),
    ],
)
def test_a_wrong_tolerance_is_one_line(changes: dict, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        PartTolerances(**changes)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("amount", [0.0, 0.01, {"amount": 0.01, "distribution": "uniform"}])
@pytest.mark.parametrize("of", [TolerancesSection, FaceTolerances])
def test_every_tolerance_is_read_back_as_it_was_given(of: type[TolerancesSection], amount: float | dict) -> None:
    names = [name for name, field in of.model_fields.items() if field.default is None]
    assert len(names) > 6
    given = of(**{name: amount for name in names if not (isinstance(amount, dict) and name.endswith("_um"))})
    record = given.model_dump(mode="json")
    assert of(**record) == given and of(**record).model_dump(mode="json") == record


def test_no_tolerance_at_all_is_one_line() -> None:
    with pytest.raises(InputError, match="all of them are 0"):
        factors_of(part_tolerances())


def test_tolerances_come_from_a_preset_or_a_file(tmp_path) -> None:
    assert read_tolerances("moulded").tolerance("shrinkage").amount == 0.001
    file = tmp_path / "own.toml"
    for text in (
        "[tolerances]\npreset = 'precision'\n[lens.outer]\ngap_mm = 0.5\n",
        "[source]\nkind = 'disc'\n[tolerances]\npreset = 'precision'\n[lens.outer]\ngap_mm = 0.5\noffset_mm = 6.0\n",
    ):
        file.write_text(text)
        tolerances = read_tolerances(str(file))
        assert (tolerances.tolerance("gap_mm").amount, tolerances.tolerance("outer_shift_mm").amount) == (0.5, 0.005)
    file.write_text("[lens.outer]\ngap_mm = 0.5\n")
    assert read_tolerances(str(file)) == PartTolerances(faces={"outer": {"gap_mm": 0.5}})
    for text, message in (
        ("[lens.outer]\ngap_mm = 9.0\n", "own.toml: lens.outer: gap_mm = 9: must be at most 5"),
        ("[lens.outer]\ngapp_mm = 0.5\n", "own.toml: lens.outer: gapp_mm = 0.5: unknown; did you mean gap_mm"),
        ("[lens.inner]\ngap_mm = 0.5\n", "own.toml: lens: inner.gap_mm: this face is what"),
        ("[tolerances]\nouter = {}\n", "own.toml: tolerances: outer: unknown"),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=message):
            read_tolerances(str(file))
    file.write_text("[lens]\n")
    with pytest.raises(InputError, match="has no \\[tolerances\\]"):
        read_tolerances(str(file))
    with pytest.raises(InputError, match="no such file"):
        read_tolerances("loose")
