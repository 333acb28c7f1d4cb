"""Dispersion formulas against published indices that did not make them, and against each other."""

import numpy as np
import pytest

from lensforge.errors import InputError
from lensforge.optics.material import C_LINE_NM, D_LINE_NM, F_LINE_NM, MATERIALS, by_abbe_number

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
