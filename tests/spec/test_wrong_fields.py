"""Wrong fields of a spec: all of them, a complete line for each, unknown names first, with the name that was meant."""

import copy
import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from addon_rows import addon_rows
from in_this_process import lensforge

import lensforge as lf
from lensforge import addon
from lensforge.errors import WrongFields
from lensforge.spec import application, load_spec, parse_spec
from lensforge.spec.application import with_tables
from lensforge.spec.spec_section import Section, section_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "rectangle.toml"


def lines_of(changes: dict[str, Any]) -> tuple[str, ...]:
    """Lines with which the shipped rectangle is refused after changes by dotted names; None leaves a field out."""
    content = copy.deepcopy(tomllib.loads(EXAMPLE.read_text(encoding="utf-8")))
    for name, value in changes.items():
        *way, last = name.split(".")
        table = content
        for part in way:
            table = table.setdefault(part, {})
        table.pop(last, None)
        if value is not None:
            table[last] = value
    with pytest.raises(WrongFields) as caught:
        parse_spec(content, "lamp.toml")
    assert str(caught.value).splitlines() == list(caught.value.lines)
    assert all(line.isprintable() and line.startswith("lamp.toml: ") for line in caught.value.lines)
    return tuple(line.removeprefix("lamp.toml: ") for line in caught.value.lines)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"source": {"kind": "disc", "diametre_mm": 2}}, "source.diametre_mm = 2: unknown; did you mean diameter_mm?"),
        ({"source": {"kind": "disc", "diameter": 2}}, "source.diameter = 2: unknown; did you mean diameter_mm?"),
        ({"targets": {"kind": "disc"}}, "targets: unknown; did you mean target?"),
        ({"name": "rgb 1.5"}, "name = 'rgb 1.5': must be up to 64 letters, digits, _ and -"),
        ({"lens.max_radius_mm": 3}, "lens.max_radius_mm = 3: unknown; it belongs to [constraints]"),
        (
            {"lamps": {"kind": "endless", "pitch_mm": 9.0, "columns": 5}},
            "lamps.columns = 5: unknown; it goes with kind = grid, or belongs to [source] or [target] or [plate]",
        ),
        (
            {"source.intensity": {"kind": "cosine"}},
            "source.intensity: unknown; it goes with kind = rectangle, disc, chips, chip_array, luminance",
        ),
        ({"lens.outer.gap_mm": {"amont": 1}}, "lens.outer.gap_mm.amont = 1: unknown; did you mean amount?"),
        ({"lens.middle": {"offset_mm": 6.0}}, "lens.middle: unknown; known here: refractive_index, "),
        ({"lens.inner.gap_mm": 0.1}, "lens: inner.gap_mm: this face is what the next is placed against; give outer."),
        ({"lens.outer.draught_deg": 2.0}, "lens.outer.draught_deg = 2.0: unknown; did you mean draft_deg?"),
        ({"lens.inner_offset_mm": 3.0}, "lens.inner_offset_mm = 3.0: unknown; it is lens.inner.offset_mm now"),
        ({"lens.fixed_outer": {}}, "lens.fixed_outer: unknown; it is lens.outer.fixed now"),
        ({"constraints.inner_draft_deg": 2.0}, "constraints.inner_draft_deg = 2.0: unknown; it is lens.inner."),
        ({"tolerances.gap_mm": 0.1}, "tolerances.gap_mm = 0.1: unknown; it is lens.outer.gap_mm now"),
        ({"target.half_width_mm": 50.0}, "target.half_width_mm = 50.0: unknown; it is width now, the whole of it"),
        (
            {"limits": [{"kind": "zone", "unit": "cd", "at_least": 1.0, "at_most_cd": 3.0}]},
            'limits.0.at_most_cd = 3.0: unknown; it is at_most now, with unit = "cd"',
        ),
        ({"photometry": {"use": "road"}}, "photometry.use = 'road': must be 'general' or 'area'"),
        (
            {"manufacture.process": "mould"},
            "manufacture.process = 'mould': did you mean moulded? It must be 'milled', 'turned', 'moulded', ",
        ),
        (
            {"manufacture.make": "insert"},
            'manufacture.make = \'insert\': unknown; it is process now: "moulded" in place of "insert", "milled" ',
        ),
        ({"target.kind": "rectangl"}, "target.kind = 'rectangl': must be one of flat_top, rectangle, disc, "),
        ({"target.kind": None}, "target: kind is missing; it must be one of flat_top, rectangle, "),
        ({"constraints.max_radius_mm": None}, "constraints.max_radius_mm: missing: outer radius: two freeform faces"),
        ({"target.kind": "image"}, "target.file: missing: PNG, TIFF, JPEG or BMP file."),
        (
            {"target.uniform_mm": "a"},
            "target.uniform_mm = 'a': must be a number or must be a",
        ),
        ({"lens.levels": 25}, "lens.levels = 25: must be a list: write [25]"),
        ({"source.position_mm": 3.0}, "source.position_mm = 3.0: must be a list"),
        ({"source.position_mm": [1, 2, 3, 4]}, "source.position_mm = list: must have at most 3 entries, not 4"),
        ({"target.uniform_mm": [90, 80, 70]}, "target.uniform_mm = list: must have at most 2 entries, not 3"),
        ({"target.uniform_mm": [90, True]}, "target.uniform_mm.1 = True: must be a number"),
        ({"lens.levels": True}, "lens.levels = True: must be a list"),
        ({"lens.levels": [25, True]}, "lens.levels.1 = True: must be a whole number"),
        ({"source.side_mm": True}, "source.side_mm = True: must be a number"),
        ({"evaluate.rays": False}, "evaluate.rays = False: must be a whole number"),
        ({"evaluate.rays": "4096"}, "evaluate.rays = '4096': must be a whole number, without quotes; write 4096"),
        ({"lens.outer.gap_mm": {"amount": True}}, "lens.outer.gap_mm.amount = True: must be a number"),
        *addon_rows("WRONG_FIELDS").values(),
        ({"source": [{"kind": "square"}]}, "source = list: must be one table: write [source]"),
        ({"constraints": 3}, "constraints = 3: must be a table"),
        ({"lens.levels": ["a"]}, "lens.levels.0 = 'a': must be a whole number"),
        (
            {"lens.outer.offset_mm": 20.0},
            "lens.outer.offset_mm = 20 is beyond constraints.max_radius_mm = 14, the largest lens; lower it, or ",
        ),
    ],
)
def test_a_wrong_field_is_named_as_written_with_what_was_meant(changes: dict[str, Any], line: str) -> None:
    (message,) = lines_of(changes)
    assert message.startswith(line)


def test_all_wrong_fields_are_told_unknown_names_first() -> None:
    lines = lines_of({"source.side_mm": -1.0, "evaluate.pixel": 9, "optimise.rays": 2, "tolerances.lens_height": 1.0})
    assert [line.split(":")[0] for line in lines] == [
        "evaluate.pixel = 9",
        "tolerances.lens_height = 1.0",
        "source.side_mm = -1.0",
        "optimise.rays = 2",
    ]


def test_a_thousand_wrong_numbers_are_a_screen() -> None:
    lines = lines_of({"lens.levels": [0] * 20, "optimise.steps_per_level": [0] * 20, "evaluate.pixels": 0})
    assert len(lines) == 21 and lines[-1] == "21 more wrong fields"


def test_the_command_says_each_in_a_line_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "a\nb.toml").write_text(
        EXAMPLE.read_text(encoding="utf-8").replace("side_mm", "sides_mm").replace("14.0", '"x"'), encoding="utf-8"
    )
    code, _, errors = lensforge("design", tmp_path / "a\nb.toml")
    first, second = errors.splitlines()
    assert code == 2
    assert first.startswith("lensforge: ") and first.endswith("source.sides_mm = 1.0: unknown; did you mean side_mm?")
    assert "a b.toml: constraints.max_radius_mm = 'x'" in second


def test_levels_that_shape_nothing_are_named_before_the_search() -> None:
    spec = load_spec(EXAMPLE)
    assert spec.lens.warnings == ()
    changed = {"optimise.seconds": None, "lens.levels": (10, 20)}
    (warning,) = spec.replace(changed).lens.warnings
    assert warning.startswith("lens.levels = [10, 20]: the finest functions are 32° wide") and '"auto"' in warning
    assert spec.replace({**changed, "lens.levels": (9, 25, 81)}).lens.warnings == ()


def test_objects_of_a_script_say_the_same() -> None:
    with pytest.raises(lf.InputError, match=r"^DiscSource: diametre_mm = 2.0: unknown; did you mean diameter_mm\?$"):
        lf.DiscSource(diametre_mm=2.0)


def test_a_table_of_an_add_on_that_is_not_installed_is_empty_or_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Specs and records that were written with it have an empty one, and keep it: their hashes count it."""
    monkeypatch.setattr(addon, "usable_addons", tuple)

    class Without(Section):
        name: str = "a"

    monkeypatch.setattr(application, "usable_addons", tuple)
    section = section_of(with_tables(Without), {"roads": []}, "t.toml")
    empty = {"name": "a", "offices": [], "roads": [], "routes": [], "sports": []}
    assert json.loads(section.model_dump_json()) == json.loads(Without().model_dump_json()) == empty
    with pytest.raises(WrongFields, match=r'^t.toml: roads.*: needs pip install "lensforge\[road\]"$'):
        section_of(Without, {"roads": [{"width_m": 7.0}]}, "t.toml")
