"""Dispersion formulas term by term, as the manuals print them; indices of materials as published."""

from math import sqrt

import numpy as np
import pytest

from lensforge.errors import InputError
from lensforge.optics.material import (
    C_LINE_NM,
    D_LINE_NM,
    F_LINE_NM,
    MATERIALS,
    NAMES,
    Formula,
    IndexTable,
    by_abbe_number,
)

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


# (material, wavelength, index, tolerance): catalogue values of SCHOTT, Malitson's table, Kasarova's measurements of
# plastics (2007, good to 1e-3), and the paper's PMMA.
KNOWN = [
    ("N-BK7", D_LINE_NM, 1.51680, 5e-6),
    ("N-BK7", F_LINE_NM, 1.52238, 5e-6),
    ("N-BK7", C_LINE_NM, 1.51432, 5e-6),
    ("fused silica", 404.656, 1.46962, 1e-5),
    ("fused silica", 589.29, 1.45841, 1e-5),
    ("fused silica", 1060.0, 1.44968, 1e-5),
    ("PMMA", 564.0, 1.4936, 5e-5),
    ("PMMA", D_LINE_NM, 1.491, 2e-3),
    ("PC", D_LINE_NM, 1.585, 1e-3),
    ("PS", D_LINE_NM, 1.592, 1e-3),
    ("COP", D_LINE_NM, 1.5305, 1e-4),
    ("COC", D_LINE_NM, 1.533, 1e-9),
    ("polyester", D_LINE_NM, 1.607, 1e-9),
    ("silicone", 550.0, 1.40929, 5e-4),
    ("silicone", 450.0, 1.41581, 5e-4),
    ("B270", D_LINE_NM, 1.52308, 5e-6),
    ("borosilicate 3.3", D_LINE_NM, 1.471, 5e-4),
]


@pytest.mark.parametrize(("name", "wavelength", "index", "tolerance"), KNOWN)
def test_published_indices(name, wavelength, index, tolerance):
    assert MATERIALS[name].index_at(wavelength) == pytest.approx(index, abs=tolerance)


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("N-BK7", 64.17),
        ("fused silica", 67.82),
        ("PC", 28.0),
        ("PS", 29.5),
        ("B270", 58.57),
        ("borosilicate 3.3", 65.41),
        ("COC", 56.2),
        ("polyester", 27.0),
    ],
)
def test_published_abbe_numbers(name, number):
    assert MATERIALS[name].abbe_number == pytest.approx(number, rel=1e-2)


@pytest.mark.parametrize("material", MATERIALS.values(), ids=lambda material: material.name)
def test_every_material_disperses_normally_where_it_may_be_used(material):
    low, high = material.range_nm
    wavelengths = np.linspace(0.9 * low, 1.1 * high, 2001)
    index = material.index(wavelengths)
    assert (np.diff(index) < 0.0).all()
    assert ((index > 1.3) & (index < 1.8)).all()
    for outside in (0.89 * low, 1.11 * high, float("nan")):
        with pytest.raises(InputError, match=f"the index of {material.name} is known from"):
            material.index_at(outside)


def test_index_and_abbe_number_come_back():
    material = by_abbe_number(1.53, 55.8)
    assert material.index_at(D_LINE_NM) == pytest.approx(1.53, abs=1e-12)
    assert material.abbe_number == pytest.approx(55.8, abs=1e-9)


def test_two_numbers_of_a_data_sheet_say_nearly_what_the_full_formula_says():
    glass = MATERIALS["N-BK7"]
    guess = by_abbe_number(glass.index_at(D_LINE_NM), glass.abbe_number)
    wavelengths = np.linspace(430.0, 700.0, 100)
    assert np.abs(guess.index(wavelengths) - glass.index(wavelengths)).max() < 3e-4
