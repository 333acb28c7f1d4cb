"""Old names of the fields of faces: the same spec comes out, and a line says the new name."""

import json
import re
import warnings
from pathlib import Path

import pytest
import tomli_w
from scenes import random_surface, small_spec

from lensforge.errors import InputError, RenamedWarning
from lensforge.scene.lens import Lens, load_lens
from lensforge.spec import ConstraintsSection, LensSection, Spec, load_spec, parse_spec
from lensforge.spec.renamed import MOVED
from lensforge.spec.spec_files import plain
from lensforge.spec.tolerances_section import read_tolerances

DOME = {"kind": "sphere", "radius_mm": 6.5}
VALUES = {
    "offset_mm": 2.5, "fixed": DOME, "coating": {"reflectance": 0.005}, "concave_radius_mm": 1.5, "draft_deg": 0.5,
    "form_um": 0.7, "waviness_um": 0.2, "ripple_um": {"amount": 0.1}, "roughness_mrad": 0.3,
    "shift_mm": {"amount": 0.03, "distribution": "normal"}, "gap_mm": 0.04, "tilt_deg": 0.2,
}  # fmt: skip


def value_of(old: str) -> object:
    field = MOVED[old].rpartition(".")[2]
    if old == "lens.fixed_inner":
        return DOME | {"radius_mm": 2.5}
    return 6.2 if old == "lens.outer_offset_mm" else VALUES[field]


def written(old: str, path: Path, **of_face: object) -> Path:
    """A small spec that has the old field, and ``of_face`` in the table of its face."""
    content = without(old).model_dump(mode="json", exclude_unset=True)
    section, _, field = old.partition(".")
    content.setdefault(section, {})[field] = value_of(old)
    content["lens"][MOVED[old].split(".")[1]] |= of_face
    path.write_text(tomli_w.dumps(plain(content)), encoding="utf-8")
    return path


def without(old: str) -> Spec:
    """A small spec without the hemisphere that the old field gives, or goes in place of."""
    holder, _, field = MOVED[old].rpartition(".")
    return small_spec(**({f"{holder.replace('.', '__')}__offset_mm": None} if field in ("offset_mm", "fixed") else {}))


@pytest.mark.parametrize("old", MOVED)
def test_an_old_name_gives_the_same_spec_and_names_the_new(old: str, tmp_path: Path) -> None:
    value = value_of(old)
    words = f"[{MOVED[old]}]" if isinstance(value, dict) else f"{MOVED[old]} = {value}"
    with pytest.warns(RenamedWarning) as said:
        found = load_spec(written(old, tmp_path / "lamp.toml"))
    assert [str(each.message) for each in said] == [f"{old} is an old name, read in this version only: write {words}"]
    assert found == without(old).replace({MOVED[old]: value}) != without(old)


@pytest.mark.parametrize("old", ["lens.inner_offset_mm", "constraints.outer_draft_deg", "tolerances.gap_mm"])
def test_old_and_new_that_differ_are_one_line(old: str, tmp_path: Path) -> None:
    new = MOVED[old]
    path = written(old, tmp_path / "lamp.toml", **{new.rpartition(".")[2]: 1.25})
    words = f"{old} = {value_of(old)} does not go with {new} = 1.25; give one of them"
    with pytest.raises(InputError, match=re.escape(words)) as refusal:
        load_spec(path)
    assert "\n" not in str(refusal.value)


def test_a_section_of_a_script_has_its_old_names_or_says_the_new() -> None:
    with pytest.warns(RenamedWarning, match=r"^inner_offset_mm is an old name.*: write inner\.offset_mm = 3\.0$"):
        assert LensSection(inner_offset_mm=3.0) == LensSection(inner={"offset_mm": 3.0})
    with pytest.raises(InputError, match=r"inner_draft_deg = 2.0: unknown; it is lens\.inner\.draft_deg now$"):
        ConstraintsSection(max_radius_mm=14.0, inner_draft_deg=2.0)


def test_tolerances_of_a_file_have_their_old_names(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text("[tolerances]\nouter_form_um = 0.25\ngap_mm = 0.125\n")
    with pytest.warns(RenamedWarning, match="write lens.outer"):
        found = read_tolerances(str(tmp_path / "own.toml"))
    assert (found.tolerance("outer_form_um").amount, found.tolerance("gap_mm").amount) == (0.25, 0.125)


def test_a_record_of_an_earlier_version_is_read_without_a_word(tmp_path: Path) -> None:
    lens = Lens.double(
        random_surface(1, 3.0), random_surface(2, 6.0), small_spec(lens__outer__draft_deg=1.0), 0, "draft"
    )
    content = {key: value for key, value in lens.to_json().items() if key != "content_sha256"}
    for old, new in MOVED.items():
        *holders, field = new.split(".")
        table = content["spec"]
        for each in holders:
            table = table[each]
        section, _, name = old.partition(".")
        content["spec"][section][name] = table.pop(field)
    del content["spec"]["lens"]["inner"], content["spec"]["lens"]["outer"]
    (tmp_path / "lens.json").write_text(json.dumps(content), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = load_lens(tmp_path / "lens.json")
    assert isinstance(found.spec, Spec) and found == lens


def test_the_road_of_the_photometry_is_said_to_be_a_table_of_its_own() -> None:
    content = small_spec().model_dump(mode="json", exclude_unset=True)
    content["photometry"] = {"use": "road", "pole_height_m": 8.0, "lenses": 24}
    with pytest.warns(RenamedWarning) as said:
        found = parse_spec(plain(content), "lamp")
    assert sorted(str(each.message) for each in said) == [
        "pole_height_m is read no more, and goes with the next version; a road is one of [[roads]]",
        'use = "road" is read in this version only: write use = "area"',
    ]
    assert (found.photometry.use, found.photometry.lenses) == ("area", 24)
