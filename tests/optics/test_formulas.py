"""Dispersion formulas by hand, term by term, as the manuals print them; and by another program where installed."""

from math import sqrt

import numpy as np
import pytest

from lensforge.errors import InputError
from lensforge.optics.dispersion_formulas import NAMES, Formula, IndexTable

W = 0.55  # um


def poles(*terms: tuple[float, float]) -> float:
    """Sum of b W^2 / (W^2 - c): Sellmeier's terms."""
    return sum(b * W**2 / (W**2 - c) for b, c in terms)


def powers(*terms: tuple[float, float]) -> float:
    """Sum of c W^k."""
    return sum(c * W**k for c, k in terms)


SCHOTT = (2.27, -0.01, 0.011, 2e-4, -1e-5, 9e-7)
SCHOTT_POWERS = tuple(zip(SCHOTT, (0, 2, -2, -4, -6, -8), strict=True))
HERZBERGER = (1.5, 0.003, 1e-4, -0.002, -1e-4, 1e-5)
POLE = 1.0 / (W**2 - 0.028)
BY_HERZBERGER = 1.5 + 0.003 * POLE + 1e-4 * POLE**2 + powers((-0.002, 2), (-1e-4, 4), (1e-5, 6))
FOUR = ((0.9, 0.01), (0.2, 0.02), (0.1, 0.03), (0.05, 0.04))
FLAT = (0.9, 0.01, 0.2, 0.02, 0.1, 0.03, 0.05, 0.04)
TWO = ((1.0, 0.01), (0.2, 0.02))
# name: (coefficients, n as the manual has it)
BY_HAND = {
    "sellmeier": ((1.0, 0.01, 0.2, 0.02), sqrt(1 + poles(*TWO))),
    "cauchy": ((1.5, 0.005, 1e-4), 1.5 + 0.005 / W**2 + 1e-4 / W**4),
    "agf 1": (SCHOTT, sqrt(powers(*SCHOTT_POWERS))),
    "agf 2": ((1.0, 0.01, 0.2, 0.02), sqrt(1 + poles(*TWO))),
    "agf 3": (HERZBERGER, BY_HERZBERGER),
    "agf 4": ((0.1, 1.1, 0.1, 0.001, 0.2), sqrt(1 + 0.1 + poles((1.1, 0.1**2)) + 0.001 / (W**2 - 0.2**2))),
    "agf 5": ((1.5, 0.01, 0.001), 1.5 + 0.01 / W + 0.001 / W**3.5),
    "agf 6": (FLAT, sqrt(1 + poles(*FOUR))),
    "agf 7": ((2.2, 0.01, 0.02, 0.003), sqrt(2.2 + 0.01 / (W**2 - 0.02) - 0.003 * W**2)),
    "agf 8": ((1.2, 1.0, 0.02, 0.003), sqrt(1.2 + poles((1.0, 0.02)) - 0.003 * W**2)),
    "agf 9": ((1.2, 1.0, 0.02, 0.1, 90.0), sqrt(1.2 + poles((1.0, 0.02), (0.1, 90.0)))),
    "agf 10": ((*SCHOTT, 1e-8, 1e-9), sqrt(powers(*SCHOTT_POWERS, (1e-8, -10), (1e-9, -12)))),
    "agf 11": ((*FLAT, 0.02, 80.0), sqrt(1 + poles(*FOUR, (0.02, 80.0)))),
    "agf 12": ((*SCHOTT, 1e-4, 1e-5), sqrt(powers(*SCHOTT_POWERS, (1e-4, 4), (1e-5, 6)))),
    "agf 13": (
        (2.27, -0.01, 1e-4, 0.011, 2e-4, -1e-5, 9e-7, 1e-8, 1e-9),
        sqrt(powers(*SCHOTT_POWERS, (1e-4, 4), (1e-8, -10), (1e-9, -12))),
    ),
    "rii 1": ((0.3, 0.8, 0.1, 0.2, 4.4), sqrt(1 + 0.3 + poles((0.8, 0.1**2), (0.2, 4.4**2)))),
    "rii 2": ((0.3, 0.8, 0.01, 0.2, 20.0), sqrt(1 + 0.3 + poles((0.8, 0.01), (0.2, 20.0)))),
    "rii 3": ((2.2, -0.01, 2.0, 0.012, -2.0), sqrt(powers((2.2, 0), (-0.01, 2), (0.012, -2)))),
    "rii 4": (
        (2.0, 0.2, 0.0, 0.3, 2.0, 0.1, 2.0, 0.2, 1.0, -0.01, 2.0),
        sqrt(2.0 + 0.2 / (W**2 - 0.3**2) + poles((0.1, 0.2)) - 0.01 * W**2),
    ),
    "rii 5": ((1.5, 0.005, -2.0, 1e-4, -4.0), powers((1.5, 0), (0.005, -2), (1e-4, -4))),
    "rii 6": ((1e-4, 0.05, 238.0, 0.002, 57.0), 1 + 1e-4 + 0.05 / (238.0 - W**-2) + 0.002 / (57.0 - W**-2)),
    "rii 7": (HERZBERGER, BY_HERZBERGER),
    "rii 8": ((0.2, 0.1, 0.02, -0.001), 0.0),
    "rii 9": (
        (2.2, 0.01, 0.02, 0.03, 0.3, 0.4),
        sqrt(2.2 + 0.01 / (W**2 - 0.02) + 0.03 * (W - 0.3) / ((W - 0.3) ** 2 + 0.4)),
    ),
}


def test_every_formula_has_its_line_here():
    assert set(BY_HAND) == set(NAMES)


@pytest.mark.parametrize("name", BY_HAND)
def test_formulas_are_those_of_the_manuals(name):
    coefficients, wanted = BY_HAND[name]
    found = Formula(name, coefficients).index(np.array([1e3 * W]))[0]
    if name == "rii 8":  # by what it says of n: (n^2 - 1) / (n^2 + 2)
        assert (found**2 - 1) / (found**2 + 2) == pytest.approx(0.2 + 0.1 * W**2 / (W**2 - 0.02) - 0.001 * W**2)
    else:
        assert found == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith("rii")])
def test_another_program_has_the_same_indices(name):
    dispersion = pytest.importorskip("optiland.materials.dispersion")
    waves = np.linspace(400.0, 900.0, 51)
    coefficients = BY_HAND[name][0]
    wanted = [dispersion.evaluate_formula(name.replace("rii", "formula"), coefficients, 1e-3 * nm) for nm in waves]
    np.testing.assert_allclose(Formula(name, coefficients).index(waves), np.array(wanted, dtype=float), rtol=1e-12)


def test_missing_coefficients_are_0_and_unknown_names_are_refused():
    waves = np.array([550.0])
    two, six = (2.27, -0.01), (2.27, -0.01, 0.0, 0.0, 0.0, 0.0)
    short, whole = (Formula("agf 1", each).index(waves)[0] for each in (two, six))
    assert short == whole == pytest.approx(sqrt(2.27 - 0.01 * W**2))
    with pytest.raises(InputError, match="dispersion formula 'agf 14': must be one of sellmeier, cauchy, agf 1"):
        Formula("agf 14", (1.0,))
    with pytest.raises(InputError, match="agf 1: 30 coefficients, at most 24"):
        Formula("agf 1", (1.0,) * 30)


def test_a_table_is_linear_between_its_rows():
    table = IndexTable((400.0, 500.0, 700.0), (1.52, 1.50, 1.49))
    np.testing.assert_allclose(table.index(np.array([400.0, 450.0, 600.0])), [1.52, 1.51, 1.495])
