"""Indices: formulas as the manuals print them, materials as published, and their change with temperature."""

import sys
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.optics.material import (
    C_LINE_NM,
    COEFFICIENTS,
    D_LINE_NM,
    F_LINE_NM,
    MATERIALS,
    UNKNOWN,
    Formula,
    IndexTable,
    TemperatureLaw,
    air_index,
    by_abbe_number,
)
from lensforge.optics.material_files import read_material
from lensforge.spec import load_spec, parse_spec

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
    assert set(BY_HAND) == set(COEFFICIENTS)


@pytest.mark.parametrize("name", BY_HAND)
def test_formulas_are_those_of_the_manuals(name):
    coefficients, wanted = BY_HAND[name]
    value = Formula(name, coefficients).index(np.array([1e3 * W]))[0]
    if name == "rii 8":  # by what it says of n: (n^2 - 1) / (n^2 + 2)
        assert (value**2 - 1) / (value**2 + 2) == pytest.approx(0.2 + 0.1 * W**2 / (W**2 - 0.02) - 0.001 * W**2)
    else:
        assert value == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("name", [name for name in COEFFICIENTS if name.startswith("rii")])
def test_another_program_has_the_same_indices(name):
    dispersion = pytest.importorskip("optiland.materials.dispersion")
    waves = np.linspace(400.0, 900.0, 51)
    coefficients = BY_HAND[name][0]
    wanted = [dispersion.evaluate_formula(name.replace("rii", "formula"), coefficients, 1e-3 * nm) for nm in waves]
    np.testing.assert_allclose(Formula(name, coefficients).index(waves), np.array(wanted, dtype=float), rtol=1e-12)


def test_missing_coefficients_are_0_and_unknown_names_are_refused():
    waves = np.array([550.0])
    two = (2.27, -0.01)
    six = (2.27, -0.01, 0.0, 0.0, 0.0, 0.0)
    short, whole = (Formula("agf 1", coefficients).index(waves)[0] for coefficients in (two, six))
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


GLASS = MATERIALS["N-BK7"]
AGF = """NM GLASS-A 2 517642.251 1.5168 64.17 0 1
ED 7.1 8.3 2.51 -0.0009 0
CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653 0 0 0 0
TD 1.86E-6 1.31E-8 -1.37E-11 4.34E-7 6.27E-10 0.17 20
LD 0.3 2.5
"""


def index(nm: float, celsius: float) -> float:
    return float(GLASS.at(GLASS.temperature, celsius).index(np.array([nm]))[0])


def air(nm: float, celsius: float) -> float:
    return float(air_index(np.array([nm]), celsius)[0])


@pytest.mark.parametrize("celsius", [-40.0, 85.0])
@pytest.mark.parametrize("um", [0.45, 0.656])
def test_the_index_is_schotts_formula_by_hand(um: float, celsius: float) -> None:
    squared = um * um
    kelvin = celsius - 20.0
    n = sqrt(
        1.0
        + 1.03961212 * squared / (squared - 0.00600069867)
        + 0.231792344 * squared / (squared - 0.0200179144)
        + 1.01046945 * squared / (squared - 103.560653)
    ) * air(1e3 * um, 20.0)
    power = 1.86e-6 * kelvin + 1.31e-8 * kelvin**2 - 1.37e-11 * kelvin**3
    power += (4.34e-7 * kelvin + 6.27e-10 * kelvin**2) / (squared - 0.17**2)
    wanted = (n + (n * n - 1.0) / (2.0 * n) * power) / air(1e3 * um, celsius)
    assert index(1e3 * um, celsius) == pytest.approx(wanted, abs=1e-15)


@pytest.mark.parametrize(
    ("low", "high", "relative", "absolute"),
    [
        (-40.0, -20.0, (2.4, 2.9, 3.3), (0.3, 0.8, 1.2)),
        (20.0, 40.0, (2.4, 3.0, 3.5), (1.1, 1.6, 2.1)),
        (60.0, 80.0, (2.5, 3.1, 3.7), (1.5, 2.1, 2.7)),
    ],
)
def test_its_changes_are_those_of_the_data_sheet(
    low: float, high: float, relative: tuple[float, ...], absolute: tuple[float, ...]
) -> None:
    """SCHOTT data sheet of N-BK7 (2017): change per kelvin, in 1e-6, at 1060.0 nm, e and g, in air and in vacuum."""
    for nm, in_air, in_vacuum in zip((1060.0, 546.074, 435.835), relative, absolute, strict=True):
        change = (index(nm, high) - index(nm, low)) / (high - low)
        assert 1e6 * change == pytest.approx(in_air, abs=0.051)
        change = (index(nm, high) * air(nm, high) - index(nm, low) * air(nm, low)) / (high - low)
        assert 1e6 * change == pytest.approx(in_vacuum, abs=0.051)


def test_air_has_its_published_index() -> None:
    """Ciddor's (1996) at 633 nm, 101325 Pa and 20 C, without CO2: 1 + 271.7e-6, and 0.9e-6 less for each kelvin."""
    assert air(633.0, 20.0) - 1.0 == pytest.approx(271.5e-6, abs=0.7e-6)
    assert air(633.0, 21.0) - air(633.0, 20.0) == pytest.approx(-0.93e-6, abs=0.02e-6)


def test_another_program_has_the_same_index() -> None:
    """It counts the wavelength in the warm air, here it is that of the same light at the reference temperature."""
    pytest.importorskip("optiland")
    from optiland.materials import MaterialFile

    (file,) = Path(sys.modules["optiland"].__path__[0]).glob("database/data-nk/glass/schott/N-BK7.yml")
    other = MaterialFile(str(file))
    for nm in (450.0, 546.074, 656.3):
        for celsius in (-40.0, 20.0, 85.0, 120.0):
            in_warm_air = 1e-3 * nm * air(nm, 20.0) / air(nm, celsius)
            wanted = np.asarray(other.n(in_warm_air, temperature=celsius)).item()
            assert index(nm, celsius) == pytest.approx(wanted, abs=3e-8)


def written(folder: Path, text: str) -> Path:
    path = folder / "c.agf"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_catalogue_states_the_law_and_a_spec_keeps_it(tmp_path: Path) -> None:
    path = written(tmp_path, AGF)
    assert read_material(path, "GLASS-A").temperature == GLASS.temperature
    spec = small_spec(lens__material="glass-a", lens__material_file=str(path))
    path.unlink()
    spec.save(tmp_path / "spec.toml")
    for copy in (spec, load_spec(tmp_path / "spec.toml"), parse_spec(spec.model_dump(mode="json"), "lens.json")):
        assert copy.lens.temperature_law == GLASS.temperature


ZEROS = (0.0,) * 4


@pytest.mark.parametrize(
    ("td", "ed", "law"),
    [
        ("TD 0 0 0 0 0 0 25", "ED 0 0 2.5 0 0", TemperatureLaw(25.0)),
        ("TD 0 0 0 0 0 0 0", "ED -1", UNKNOWN),
        ("TD", "ED", UNKNOWN),
        ("", "", UNKNOWN),
        ("TD - - - - - -", "ED _ _", UNKNOWN),
        ("TD -1.2E-4", "ED 68", TemperatureLaw(20.0, (-1.2e-4, *ZEROS, 0.0), expansion_per_k=68e-6)),
        ("TD 1E-6 0 0 0 0 0.2 0", "ED 8.1", TemperatureLaw(0.0, (1e-6, *ZEROS, 0.2), expansion_per_k=8.1e-6)),
        ("TD 1E-6 0 0 0 0 0.2 22", "ED 8.1", TemperatureLaw(22.0, (1e-6, *ZEROS, 0.2), expansion_per_k=8.1e-6)),
    ],
)
def test_zeros_and_missing_numbers_of_a_catalogue(tmp_path: Path, td: str, ed: str, law: TemperatureLaw) -> None:
    lines = [line for line in AGF.splitlines() if line[:2] not in ("TD", "ED")]
    assert read_material(written(tmp_path, "\n".join([*lines, td, ed])), "GLASS-A").temperature == law


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"material": "N-BK7", "index_per_k": 1e-6}, "index_per_k: N-BK7 has its own"),
        ({"material": "N-BK7", "expansion_per_k": 1e-6}, "expansion_per_k: N-BK7 has its own"),
        ({"material": "N-BK7", "reference_temperature_c": 22.0}, "reference_temperature_c: N-BK7 has its own"),
        ({"index_per_k": 0.01}, r"lens.index_per_k = 0.01: .*0\.001"),
        ({"expansion_per_k": 0.01}, r"lens.expansion_per_k = 0.01: .*0\.001"),
        ({"reference_temperature_c": 900.0}, r"lens.reference_temperature_c = 900.0: .*400"),
    ],
)
def test_a_spec_that_contradicts_itself_is_one_line(fields: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        small_spec(**{f"lens__{name}": value for name, value in fields.items()})
    assert "\n" not in str(error.value)


def test_schotts_formula_is_extrapolated_with_a_warning() -> None:
    assert GLASS.temperature.warnings(140.0) == () == TemperatureLaw(index_per_k=1e-6).warnings(300.0)
    (message,) = GLASS.temperature.warnings(150.0)
    assert message == "the index at 150 C is extrapolated: SCHOTT's formula holds from -100 to 140 C"
