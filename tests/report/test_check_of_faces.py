"""The record of a check has an entry for each face of the body, by its name."""

import json
from dataclasses import replace

import numpy as np
import pytest
from filled import filled
from result_folders import make_check, small_lens

from lensforge.errors import InputError
from lensforge.results import Fact
from lensforge.shop.check_facts import check_facts
from lensforge.shop.check_measures import BallClearance, BoreClearance
from lensforge.shop.check_result import Check

NAMES = ("cap", "side", "wall", "exit")


def four(**changes: object) -> Check:
    """The check of a body of four faces."""
    check = make_check(small_lens())
    fields = {name: getattr(check, name) for name in Check.model_fields}
    another = {"lens": "0" * 64}  # which has these faces
    return Check(**{**fields, "inputs": another, **dict.fromkeys(NAMES, check.faces["outer"]), **changes})


def test_a_body_of_four_faces_has_an_entry_for_each(tmp_path) -> None:
    check = four()
    check.write(tmp_path)
    content = json.loads((tmp_path / "check.json").read_text(encoding="utf-8"))
    for name in NAMES:
        assert {"best_fit_sphere", "cutter", "draft_deg"} <= set(content[name]) and "sag_mm" not in content[name]
    again = Check.read(tmp_path, lens=check.lens)
    assert again == check and list(again.faces) == list(NAMES) and again.sha256 == check.sha256
    assert again.row()["wall.cutter.radius_mm"] == 1.0 and again.row()["walls.thinnest.thickness_mm"] == 1.875
    assert np.array_equal(again.faces["exit"].sag_mm, check.faces["exit"].sag_mm, equal_nan=True)
    assert again != check.model_copy(update={"exit": check.faces["exit"].model_copy(update={"area_mm2": 1.0})})


def test_facts_are_of_each_face_and_a_plot_of_the_one_that_is_named() -> None:
    check = make_check(small_lens())
    titles = [group.title for group in check_facts(check)]
    assert titles[:3] == ["Inner face", "Outer face", "Wall"]
    other = four().faces["cap"].sag_mm.T
    for name, chosen in {**{name: {"surface": name} for name in NAMES}, "exit": {}}.items():
        marked = four(**{name: four().faces[name].model_copy(update={"sag_mm": other})}).plot(**chosen)
        assert np.array_equal(np.ma.filled(marked.images[0].get_array(), np.nan), other.T, equal_nan=True), name
    with pytest.raises(InputError, match="surface = 'inner': must be one of cap, side, wall, exit"):
        four().plot(surface="inner")


def test_the_flat_that_is_advised_marks_the_part() -> None:
    """Of a base of 30 mm: at 0.95 of its radius."""
    spec = small_lens().spec

    def mark(**base: float) -> Fact:
        lens = replace(small_lens(), spec=spec.replace(base={"kind": "cylinder", "diameter_mm": 30.0, **base}))
        groups = {group.key: group for group in check_facts(make_check(lens))}
        return groups["orientation"].fact("azimuth_mark")

    bare = mark()
    assert bare.value == "none" and bare.notice.endswith(": base.flat_mm = 14.25 cuts a flat across +x")
    marked = mark(flat_mm=14.25)
    assert marked.value == "flat" and "14.25" in marked.note and marked.notice == ""


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"verdicts": None}, "tools and findings are on top"),
        ({"relief": BallClearance(faces={"top": filled(BoreClearance)})}, "tools and findings are on top"),
        ({"chart_axis": np.linspace(-1.0, 1.0, 5)}, r"cap.sag_mm: shape \(21, 21\), must be of the 5 nodes"),
        ({"cap": 3.0}, "cap"),
    ],
)
def test_entries_that_do_not_fit_each_other_are_refused(changes, message) -> None:
    if "verdicts" in changes:
        changes = {"verdicts": tuple(replace(verdict, place="top") for verdict in four().verdicts)}
    with pytest.raises(ValueError, match=message):
        four(**changes)
