"""Change of the index with temperature: SCHOTT's formula by hand, its data sheet, another program, and files."""

import sys
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS, UNKNOWN, TemperatureLaw, air_index
from lensforge.optics.material_files import read_material
from lensforge.spec import load_spec, parse_spec

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
    squared, kelvin = um * um, celsius - 20.0
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
        found = (index(nm, high) - index(nm, low)) / (high - low)
        assert 1e6 * found == pytest.approx(in_air, abs=0.051)
        found = (index(nm, high) * air(nm, high) - index(nm, low) * air(nm, low)) / (high - low)
        assert 1e6 * found == pytest.approx(in_vacuum, abs=0.051)


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
    for each in (spec, load_spec(tmp_path / "spec.toml"), parse_spec(spec.model_dump(mode="json"), "lens.json")):
        assert each.lens.temperature_law == GLASS.temperature


@pytest.mark.parametrize(
    ("td", "ed", "law"),
    [
        ("TD 0 0 0 0 0 0 25", "ED 0 0 2.5 0 0", TemperatureLaw(25.0)),
        ("TD 0 0 0 0 0 0 0", "ED -1", UNKNOWN),
        ("TD", "ED", UNKNOWN),
        ("", "", UNKNOWN),
        ("TD - - - - - -", "ED _ _", UNKNOWN),
        ("TD -1.2E-4", "ED 68", TemperatureLaw(20.0, (-1.2e-4, 0, 0, 0, 0, 0), expansion_per_k=68e-6)),
        ("TD 1E-6 0 0 0 0 0.2 0", "ED 8.1", TemperatureLaw(0.0, (1e-6, 0, 0, 0, 0, 0.2), expansion_per_k=8.1e-6)),
        ("TD 1E-6 0 0 0 0 0.2 22", "ED 8.1", TemperatureLaw(22.0, (1e-6, 0, 0, 0, 0, 0.2), expansion_per_k=8.1e-6)),
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
    (words,) = GLASS.temperature.warnings(150.0)
    assert words == "the index at 150 C is extrapolated: SCHOTT's formula holds from -100 to 140 C"
