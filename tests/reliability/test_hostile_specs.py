"""Specs from anywhere: texts that no spec needs are refused at once, and values in a script as those of a file."""

import datetime
import time
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

import lensforge as lf
from lensforge.errors import InputError
from lensforge.spec import parse_spec

SPEC = """
[source]
kind = "square"
side_mm = 1.0
[lens]
inner_offset_mm = 3.0
outer_offset_mm = 6.0
[constraints]
cavity_height_mm = 1.0
cavity_radius_mm = 1.0
min_thickness_mm = 1.0
max_radius_mm = 7.0
[target]
kind = "cross"
length_mm = 9.0
stroke_mm = 3.0
distance_mm = 50.0
receiver_mm = 20.0
"""
MIB = 2**20
FEW_SECONDS = 10.0  # on a machine with other work; none of these takes one alone


def _refused(path: Path, words: str) -> str:
    start = time.perf_counter()
    with pytest.raises(InputError, match=words) as refusal:
        lf.load_spec(path)
    assert time.perf_counter() - start < FEW_SECONDS
    return _lines(refusal.value)


def _lines(error: InputError) -> str:
    """The message, each line of which a terminal shows; at most a screen of them."""
    lines = str(error).split("\n")
    assert len(lines) <= 21 and all(line.isprintable() and len(line) < 700 for line in lines)
    return str(error)


def _with(changes: str) -> bytes:
    return (SPEC + changes).encode()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"a = " + b"[" * 1000 + b"]" * 1000, "nested too deep|not readable as TOML"),
        (b"a = " + b"{a=" * 200 + b"1" + b"}" * 200, "nested too deep"),
        (b".".join([b"a"] * 100_000) + b" = 1", "dotted name of more than 64 parts"),
        (b"[" + b" . ".join([b'"a b"'] * 100_000) + b"]", "dotted name of more than 64 parts"),
        (b"x = {y = '''it''''', " + b".".join([b"'a'"] * 100_000) + b" = 1}", "dotted name of more than 64 parts"),
        (b'x = {y = """it""""", ' + b".".join([b'"\\""'] * 100_000) + b" = 1}", "dotted name of more than 64 parts"),
        (b"x = " + b"9" * 5000, "4300 digits"),
        (_with("[optimise]\npixels = 0x" + "f" * 100_000), "optimise.pixels = a whole number of 400000 bits"),
        (b"a = [" + b"1," * 2_000_000 + b"]", "4000006 characters besides texts"),
        (b"".join(b"k%d=1\n" % k for k in range(10**6)), "characters besides texts"),
        (SPEC.encode("utf-16"), "UTF-16 or UTF-32; save it as UTF-8"),
        (SPEC.encode("utf-16-le"), "UTF-16 or UTF-32; save it as UTF-8"),
        (SPEC.encode("utf-32-be"), "UTF-16 or UTF-32; save it as UTF-8"),
        (b"name = '\xff'", "utf-8"),
        (b'name = "\\uD800"', "not readable as TOML"),
        (b'name = "a\0b"', "not readable as TOML"),
        (_with(f"{'y' * 100_000} = 1"), r"target.yyy.*\.\.\."),
        (_with('"a\\nb\\u001b[31m" = 1'), r"target.a\?b\?\[31m"),
        (SPEC.replace('"cross"', f'"{"y" * 100_000}"').encode(), "target"),
        (SPEC.replace("1.0", "1979-05-27T07:32:00Z", 1).encode(), "source.side_mm = datetime"),
        (SPEC.replace('kind = "square"', 'kind = "luminance"\nfile = "a\\u0000b"').encode(), "cannot be printed"),
        (SPEC.replace('kind = "square"', 'kind = "luminance"\nfile = "a\\nb"').encode(), "cannot be printed"),
        (SPEC.replace('kind = "square"', 'kind = "luminance"\nfile = "~/a"').encode(), "~ does not stand for"),
        (SPEC.replace('kind = "square"', f'kind = "luminance"\nfile = "{"a/" * 2500}"').encode(), "a path has 4096"),
    ],
)
def test_texts_that_no_spec_needs_are_refused_in_one_line(content: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / "spec.toml").write_bytes(content)
    _refused(tmp_path / "spec.toml", words)


def test_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    (tmp_path / "plain.toml").write_bytes(SPEC.encode())
    (tmp_path / "marked.toml").write_bytes(SPEC.encode("utf-8-sig").replace(b"\n", b"\r\n"))
    plain, marked = (lf.load_spec(tmp_path / f"{name}.toml") for name in ("plain", "marked"))
    assert marked == plain.replace(name="marked")


def test_a_file_of_a_gigabyte_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "spec.toml").open("wb") as file:
        file.truncate(1024 * MIB)
    tracemalloc.start()
    _refused(tmp_path / "spec.toml", "1024 MiB, must be at most 32 MiB")
    assert tracemalloc.get_traced_memory()[1] < MIB
    tracemalloc.stop()


def test_long_texts_and_comments_do_not_count(tmp_path: Path) -> None:
    """An array that Spec.save wrote is one text; only what the reader takes apart counts."""
    words = "# " + "a.b." * 2000 + "\n"
    (tmp_path / "spec.toml").write_text(SPEC + words * 400)
    assert lf.load_spec(tmp_path / "spec.toml").source.side_mm == 1.0
    target = lf.ArrayTarget([[1.0, 0.5], [0.0, 1.0]] * 300, width_mm=9.0, distance_mm=50.0, receiver_mm=20.0)
    spec = lf.load_spec(tmp_path / "spec.toml").replace(target=target)
    spec.save(tmp_path / "saved.toml")
    assert lf.load_spec(tmp_path / "saved.toml") == spec


CHANGES: list[tuple[str, Any, str]] = [
    ("lens.levels", [1] * 10**6, "lens.levels = list"),
    ("lens.levels", [10**9], "lens.levels.0 = 1000000000"),
    ("lens.levels", [9000, 9000], "18000 functions"),
    ("lens.levels", [10**5000], "lens.levels.0 = a whole number"),
    ("lens.material", "x" * 201, "lens.material"),
    ("lens.material", "a\nb", "cannot be printed"),
    ("source.flux_w", 1e308, "flux_w = 1e\\+308"),
    ("source.flux_w", 1e-320, "flux_w = 1e-320"),
    ("source.flux_lm", 5e-324, "flux_lm = 5e-324"),
    ("source.luminous_efficacy_lm_per_w", 5e-324, "luminous_efficacy_lm_per_w"),
    ("source.rotate_z_deg", 1e308, "rotate_z_deg = 1e\\+308"),
    ("source.spectrum", {"kind": "table", "wavelength_nm": [400, 500], "weight": [1e308, 1e308]}, "weight.0"),
    ("source.spectrum", {"kind": "table", "wavelength_nm": [400, 500], "weight": [5e-324, 0]}, "not all zero"),
    ("source.spectrum", {"kind": "table", "wavelength_nm": [400, 400.0000000001], "weight": [1, 1]}, "by 1e-06 at"),
    ("optimise.steps_per_level", [10**18] * 4, "steps_per_level.0"),
    ("optimise.steps_per_level", [1] * 10**6, "steps_per_level = list"),
    ("optimise.uniformity_steps", 10**18, "uniformity_steps"),
    ("optimise.rays", 10**18, "optimise.rays"),
    ("evaluate.filter_variance", 1e308, "filter_variance"),
    ("evaluate.rays", 2**63, "evaluate.rays"),
    ("manufacture.tools", [{}] * 101, "manufacture.tools"),
    ("name", "\ud800", "name"),
]


@pytest.mark.parametrize(
    ("field", "value", "words"), CHANGES, ids=[f"{row}-{each[0]}" for row, each in enumerate(CHANGES)]
)
def test_values_beyond_all_measure_are_refused_in_a_script_as_in_a_file(field: str, value: Any, words: str) -> None:
    spec = lf.Spec(
        source=lf.SquareSource(side_mm=1.0),
        lens=lf.LensSection(inner_offset_mm=3.0, outer_offset_mm=6.0),
        constraints=lf.ConstraintsSection(
            cavity_height_mm=1.0, cavity_radius_mm=1.0, min_thickness_mm=1.0, max_radius_mm=7.0
        ),
        target=lf.CrossTarget(length_mm=9.0, stroke_mm=3.0, distance_mm=50.0, receiver_mm=20.0),
    )
    start = time.perf_counter()
    with pytest.raises(InputError, match=words) as refusal:
        spec.replace({field: value})
    assert time.perf_counter() - start < FEW_SECONDS
    _lines(refusal.value)


@pytest.mark.parametrize("value", [1e-30, 1e12])
def test_the_ends_of_what_light_may_be_are_sound(value: float) -> None:
    from lensforge.sources.build_source import build_source, summarise

    for section in (
        lf.SquareSource(side_mm=1e9, flux_w=value),
        lf.DiscSource(diameter_mm=1e-6, flux_lm=value, luminous_efficacy_lm_per_w=1e-6),
        lf.DiscSource(
            diameter_mm=1.0,
            flux_w=value,
            intensity={"kind": "table", "gamma_deg": [0.0, 1e-4, 180.0], "intensity": [value, value, 0.0]},
        ),
    ):
        source = build_source(section)
        assert summarise(source, section).flux_w == source.flux_w > 0.0
        assert source.sample(64, 1).flux.sum() == pytest.approx(source.flux_w)


def test_datetimes_and_tables_in_a_script_are_named() -> None:
    with pytest.raises(InputError, match="side_mm = datetime"):
        lf.SquareSource(side_mm=datetime.datetime(2024, 1, 1))
    deep: Any = 1.0
    for _ in range(20_000):
        deep = [deep]
    with pytest.raises(InputError, match="side_mm = list"):
        lf.SquareSource(side_mm=deep)
    with pytest.raises(InputError, match="values"):
        lf.ArrayTarget(deep, width_mm=9.0, distance_mm=50.0, receiver_mm=20.0)
    with pytest.raises(InputError, match="source: missing"):
        parse_spec({"target": deep}, "deep")
