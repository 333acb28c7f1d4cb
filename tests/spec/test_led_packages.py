"""LED packages by name: each stands for a source whose étendue is that of its chip; names as people type them."""

import sys
import tomllib
from math import acos, cos, hypot, pi, radians, sin, sqrt
from pathlib import Path

import pytest
from in_this_process import lensforge

from lensforge.errors import InputError
from lensforge.sources.build_source import build_source
from lensforge.spec import parse_spec
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.led_packages import LedPackage, led_package, led_packages, near_packages
from lensforge.spec.new_spec import source_in, source_note

sys.path.append(str(Path(__file__).parents[2] / "docs"))
import make_led_table

NEW = ("new", "--target", "beam:40", "--max-radius", "25", "--material", "PMMA", "--source")
PACKAGES = led_packages()


def test_there_are_about_forty_classes_of_all_sorts_without_a_vendor() -> None:
    assert 40 <= len(PACKAGES) <= 50
    assert {"3030", "2835", "3535 dome", "COB LES 9", "VCSEL array"} <= PACKAGES.keys()
    assert len({name.lower() for name in PACKAGES}) == len(PACKAGES)
    for package in PACKAGES.values():
        assert 0.0 < package.least < package.most and package.unit in ("lm", "W")
        assert 1.0 <= package.dome_index < 1.6 and 0.0 < package.beam_deg < 180.0
        assert package.height_mm == package.width_mm or package.shape == "rectangle"


@pytest.mark.parametrize("package", PACKAGES.values(), ids=list(PACKAGES))
def test_each_package_is_a_source_of_the_etendue_of_its_chip(package: LedPackage) -> None:
    """π A n² of a chip of area A in a dome of index n; half of the peak intensity at half of the beam's width."""
    section = EmitterSection.kinds[package.shape](**package.source)
    source = build_source(section, None)
    rays = source.sample(2**12, 0)
    area = package.width_mm * package.height_mm * (pi / 4.0 if package.shape == "disc" else 1.0)
    etendue = float((rays.flux / source.radiances(2**12, 0)).sum())  # type: ignore[attr-defined]
    power = getattr(getattr(section, "intensity", None), "power", 1.0)
    assert cos(radians(package.beam_deg / 2.0)) ** power == pytest.approx(0.5, rel=2e-3)
    if power <= 2.0:  # else few rays stand for the wide angles
        assert etendue == pytest.approx(pi * area * package.dome_index**2, rel=0.02)


@pytest.mark.parametrize(
    ("typed", "source"),
    [
        ("3030", {"kind": "square", "side_mm": 2.4}),
        ("cob-les-9", {"kind": "disc", "diameter_mm": 9.0}),
        ("Cob LES  9", {"kind": "disc", "diameter_mm": 9.0}),
        ("3535_DOME", {"kind": "square", "side_mm": 1.974}),  # 1.41 times 1.4
        ("csp 1010", {"kind": "rectangle", "width_mm": 1.0, "height_mm": 1.0,
                      "intensity": {"kind": "cosine", "power": 0.646}}),
    ],
)  # fmt: skip
def test_a_name_is_the_source_that_it_stands_for(typed: str, source: dict[str, object]) -> None:
    assert source_in(typed) == source
    assert source_note(typed).startswith(f"package {led_package(typed).name}: ")  # type: ignore[union-attr]
    assert source_note("square:2.4") == ""


def test_a_new_spec_names_the_package_beside_its_source() -> None:
    code, text, _ = lensforge(*NEW, "3535-dome")
    (line,) = (line for line in text.splitlines() if "package" in line)
    comment = "package 3535 dome: 1.4 × 1.4 mm in a dome of index 1.41, 120 to 450 lm"
    assert code == 0 and line.startswith('kind = "square" ') and line.endswith(f"# {comment}")
    assert parse_spec(tomllib.loads(text), "lamp").source.side_mm == 1.974
    code, text, _ = lensforge(*NEW, "CSP 1919")
    assert code == 0 and parse_spec(tomllib.loads(text), "lamp").source.intensity.power == 0.646
    assert "package" not in lensforge(*NEW, "square:2")[1]


def test_a_name_that_is_not_known_is_told_the_near_ones_in_a_line() -> None:
    code, _, errors = lensforge(*NEW, "cob-les-10")
    near = "did you mean COB LES 30 or COB LES 17 or COB LES 14 or COB LES 12; give square:SIDE"
    assert code == 2 and near in errors and len(errors.strip().splitlines()) == 1
    assert near_packages("3031") == ["3030", "3014"] and near_packages("zzz") == []
    with pytest.raises(InputError, match=r"--source zzz: no kind with its size, no package and no file .*; give squ"):
        source_in("zzz")


def test_a_file_of_that_name_is_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("3030").write_bytes(b"")
    assert source_in("3030")["kind"] == "rayfile" and source_note("3030") == ""


def test_the_names_are_listed() -> None:
    code, listed, _ = lensforge("new", "--source", "list")
    rows = dict(line.split("\t") for line in listed.splitlines())
    assert code == 0 and list(rows) == list(PACKAGES)
    assert rows["VCSEL array"] == "1 × 0.8 mm, beam of 20°, 0.5 to 4 W"


def angle_of_most(power: float) -> float:
    """Angle (rad) that bounds nine tenths of the light of a cosine to ``power``, the brightest first."""
    return acos(0.1 ** (1.0 / (power + 1.0))) if power >= 1.0 else acos(0.9 ** (1.0 / (power + 1.0)))


@pytest.mark.parametrize("name", ["3030", "COB LES 9", "7020", "VCSEL array", "CSP 1010", "5050 dome"])
def test_the_smallest_lens_of_the_table_is_that_of_the_closed_form(name: str) -> None:
    """π R² Ω holds π A n² sin² of the angle within which nine tenths are; at 0 where light is brightest at grazing."""
    package = PACKAGES[name]
    area = package.width_mm * package.height_mm * (pi / 4.0 if package.shape == "disc" else 1.0)
    power = package.source.get("intensity", {}).get("power", 1.0)
    angle = angle_of_most(power)
    part = 0.9 if power == 1.0 else sin(angle) ** 2 if power > 1.0 else 1.0 - sin(angle) ** 2
    extent_mm = 0.5 * package.dome_index * hypot(package.width_mm, package.height_mm)
    if package.shape == "disc":
        extent_mm /= sqrt(2.0)
    for beam_deg, radius_mm in zip(make_led_table.BEAMS_DEG, make_led_table.smallest_radii_mm(package), strict=True):
        solid_angle = 2.0 * pi * (1.0 - cos(radians(0.5 * beam_deg)))
        etendue_mm = sqrt(area * package.dome_index**2 * part / solid_angle)
        assert radius_mm == pytest.approx(max(etendue_mm, extent_mm), rel=0.01), f"{beam_deg}"
