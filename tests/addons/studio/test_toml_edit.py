"""Edits of a text keep everything else of it, for every value of every shipped spec."""

import tomllib
from collections.abc import Iterator

import pytest

import lensforge as lf
from lensforge.addons.studio.toml_edit import Place, edited
from lensforge.spec.shipped_specs import shipped_specs

SPECS = shipped_specs()


def places(value: object, before: Place = ()) -> Iterator[tuple[Place, object]]:
    if isinstance(value, dict):
        for name, item in value.items():
            yield from places(item, (*before, name))
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for number, item in enumerate(value):
            yield from places(item, (*before, number))
    else:
        yield before, value


def comments(text: str) -> list[str]:
    return [line[line.index("#") :].rstrip() for line in text.splitlines() if "#" in line and '"#' not in line]


@pytest.mark.parametrize("name", ["quickstart", "road_m3", "two_distances", "backlight_plate"])
def test_a_value_is_set_and_left_out_and_all_else_stays(name: str) -> None:
    text = SPECS[name].read_text(encoding="utf-8")
    for place, value in places(tomllib.loads(text)):
        result = edited(text, place, 7.25)
        assert comments(result) == comments(text)
        read = dict(places(tomllib.loads(result)))
        assert read == dict(places(tomllib.loads(text))) | {place: 7.25}
        gone = dict(places(tomllib.loads(edited(text, place, None))))
        assert gone == {key: item for key, item in places(tomllib.loads(text)) if key != place}, value


def test_tables_are_added_and_a_derived_value_takes_its_comments_place() -> None:
    text = "[constraints]\nmax_radius_mm = 14.0\n# cavity_radius_mm = 1.2   # derived: of the source\n\n[base]\n"
    result = edited(text, ("constraints", "cavity_radius_mm"), 2.5)
    assert result == text.replace("# cavity_radius_mm = 1.2 ", "cavity_radius_mm = 2.5 ")
    made = edited(edited(result, ("limits", 0), {"kind": "zone"}), ("limits", 0, "at_most"), 3)
    assert tomllib.loads(made) == tomllib.loads(result) | {"limits": [{"kind": "zone", "at_most": 3}]}
    assert made.startswith(result.rstrip()) and "derived: of the source" in made


def test_what_has_no_place_is_refused_in_one_line() -> None:
    with pytest.raises(lf.InputError, match=r"^a\.b: cannot be changed beside what stands there; change the text$"):
        edited("a = 3\n", ("a", "b"), 4)
