"""Records that came from anywhere: one line, at once, in little memory, and no value that the writer did not write.

Each change is stamped anew with the checksums that it breaks, so that the record's own classes must refuse it.
"""

import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nightly import first_by_day
from refusals import changed, content_of, refusal, refusal_in_little_memory
from result_folders import make_folder, make_light, make_results, page_of, small_lens

import lensforge as lf
from lensforge.light.evaluation_result import Light
from lensforge.results import Conditions, Record, Text
from lensforge.runs.stored import load_results
from lensforge.search.design_result import Design, Level

pytestmark = pytest.mark.usefixtures("no_warnings")

DEEP = "[" * 3000 + "]" * 3000
TEXTS = {
    "nested": '{"schema": ' + DEEP + "}",
    "nested at its end": '{"schema": "lensforge-evaluate-3", "seed": ' + '{"a": ' * 900 + "1" + "}" * 901,
    "digits": '{"schema": "lensforge-evaluate-3", "seed": 1' + "0" * 5000 + "}",
    "many values": '{"schema": [' + "0," * 5_000_000 + "0]}",
    "many tables": '{"schema": [' + "{}," * 5_000_000 + "0]}",
    "no text": "\udcff\udcfe",
    "half a character": '{"schema": "\\ud800"}',
    "a list": "[1, 2]",
    "a number": "1e999",
    "not finite": '{"schema": NaN}',
    "nothing": "",
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
@pytest.mark.parametrize("name", ["lens.json", "evaluate.json", "run.json"])
def test_a_text_that_is_no_record_is_one_line(folder: Path, name: str, text: str) -> None:
    (folder / name).write_bytes(text.encode("utf-8", "surrogateescape"))
    assert name in refusal_in_little_memory(lambda: lf.load(folder))


@pytest.mark.parametrize("name", ["lens.json", "evaluate.json", "evaluate.npz", "lens.step", "check.npz"])
@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "loop"])
def test_what_is_no_file_is_not_waited_for(folder: Path, name: str, kind: str) -> None:
    path = folder / name
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero" if kind == "device" else path.name)
    if (name, kind) == ("evaluate.json", "loop"):
        assert "evaluate" in load_results(folder).missing  # as a link that leads nowhere
    else:
        assert name in refusal(lambda: load_results(folder))


def cases(table: dict[str, list[Any]]) -> list[tuple[str, Any]]:
    """Each place with each of its values."""
    return [(where, value) for where, values in table.items() for value in values]


def short(value: object) -> str:
    """A name of a case, which a terminal shows on one line."""
    return repr(value)[:24]


LENS = {
    "inner": [[], 3.0, {}, "srbf", None],
    "inner.levels": [[], [10**9], [9] * 1000, [0], 9, [9.5], [-9]],
    "inner.sigma_c": [1e300, 1e-300, 0.0, -1.0, "2", [1.75], 10**400],
    "inner.offset_mm": [1e18, 1e308, 5e-324, 0.0, -3.0, [], True],
    "inner.weights_mm": [[], [1e308] * 9, [1e18] * 9, [-1e9] * 9, [0.0] * 10, "0" * 9, {}],
    "inner.symmetry": ["triangle", "", 3, "square\n"],
    "inner.kind": ["asphere", "nurbs", "", "\x1b[31m", None, 7],
    "outer": [{"kind": "asphere", "vertex_mm": 1e308, "radius_mm": -1.0, "conic": 0.0, "coefficients": []}],
    "seed": [-1, 10**400, 1.5, None, "0"],
    "spec": [[], {}, None, {"a": {}}],
    "spec.constraints.max_radius_mm": [1e-300, 1e308, -1.0],
    "spec.source.side_mm": [1e308, -1.0, []],
    "spec.source.flux_w": [1e308, 1e-320, 0.0],
    "spec.target.distance_mm": [1e308, "\x00"],
    "units": [{"length": "m", "angle": "rad"}, []],
}


@pytest.mark.parametrize(("where", "value"), cases(LENS), ids=short)
def test_nothing_but_a_lens_is_a_lens(folder: Path, where: str, value: object) -> None:
    changed(folder / "lens.json", where, value)
    assert "lens.json" in refusal(lambda: lf.load_lens(folder / "lens.json"))


RECORD = {
    "rays": [10**18, -1, 10**400, 1e9, True],
    "pixels": [3, 1, 20_000, 0],
    "receivers": [[], {}, None, [{}], 3],
    "receivers.0.width": [1e300, 5e-324, 0.0, -300.0],
    "receivers.0.kind": ["torus", "", None],
    "receivers.0.nmse.value": [1e300, -1e300, 1e308 * 10, [], "0.1"],
    "receivers.0.nmse.standard_error": [-1.0, 1e300],
    "receivers.0.flux.detected": [-0.5, 1.5, 0.2],
    "receivers.0.map": [[[1.0]], None],
    "nmse.value": [1e300, -1e300, 1e308 * 10, [], "0.1"],
    "nmse.standard_error": [-1.0, 1e300],
    "flux.detected": [-0.5, 1.5, 0.2],
    "lumens_per_watt": [5e-324, 1e308],
    "criteria": [[{}] * 20_000, {}, None],
    "inputs.lens": ["0" * 63, "Z" * 64, "0" * 64 + "\n", None],
    "seconds": [-1.0],
    "more": [1, {}, None],
}


@pytest.mark.parametrize(("where", "value"), cases(RECORD), ids=short)
def test_nothing_but_a_record_is_a_record(folder: Path, where: str, value: object) -> None:
    changed(folder / "evaluate.json", where, value)
    assert "evaluate.json" in refusal(lambda: Light.read(folder))


def test_a_history_is_bounded(folder: Path) -> None:
    level = content_of(folder / "design.json")["history"][0]
    lens = lf.load_lens(folder / "lens.json")
    changed(folder / "design.json", "history", [level] * 1000)
    assert "history" in refusal(lambda: Design.read(folder, lens=lens))
    changed(folder / "design.json", "history", [{**level, "loss": [0.0] * 1_000_001}])
    assert "loss" in refusal(lambda: Design.read(folder, lens=lens))


def test_a_record_that_was_edited_says_so(folder: Path) -> None:
    path = folder / "evaluate.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    content["rays"] += 1
    path.write_text(json.dumps(content), encoding="utf-8")
    assert re.search(r"damaged or was edited; run `lensforge evaluate` again", refusal(lambda: Light.read(folder)))
    del content["content_sha256"]
    path.write_text(json.dumps(content), encoding="utf-8")
    assert "content_sha256" in refusal(lambda: Light.read(folder))


@pytest.mark.parametrize("name", ["../up", "/etc/x", "a/b", ".hidden", "", "x" * 300, "a\x00b", "a\n", "-rf"])
def test_names_of_conditions_stay_inside_the_folder(folder: Path, name: str) -> None:
    light = make_light(small_lens(), conditions=Conditions.of(rays=64))
    light.write(folder, "evaluate_64rays")
    changed(folder / "evaluate_64rays.json", "conditions.name", name)
    assert "conditions.name" in refusal(lambda: load_results(folder))


def test_a_record_belongs_into_the_file_of_its_name(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "run", ("design",))
    make_light(small_lens(), conditions=Conditions.of(rays=64)).write(folder, "evaluate_other")
    found = load_results(folder)
    assert not found.others
    assert "belongs into evaluate_64rays.json" in found.outdated["evaluate_other"]


class Words(Record):
    """A record of one text."""

    words: Text


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("a\nb\tc\r\n", "a b c  "),
        ("\x1b[31mred\x00", "\ufffd[31mred\ufffd"),
        ("half \ud800", "half \ufffd"),
        ("thin\u2009space, π, é", "thin\u2009space, π, é"),
        ("\u202egnp.exe", "\ufffdgnp.exe"),
    ],
)
def test_a_text_can_be_printed_on_any_page_or_terminal(given: str, kept: str) -> None:
    assert Words(words=given).words == kept
    assert Words(words=kept).words == kept


def test_a_text_is_no_longer_than_a_page_can_show() -> None:
    assert len(Words(words="x" * 10**6).words) == 10_000


def _square(side: float) -> dict[str, Any]:
    return {"width": side, "height": side, "window": {"width": side, "height": side, "radius": None}}


def extreme_lights() -> dict[str, dict[str, Any]]:
    """Lights that every range allows, and no lens makes."""
    dark = {name: np.zeros((16, 16)) for name in ("map", "raw_map", "target_map")}
    spot = np.zeros((16, 16))
    spot[3, 5] = 1e30
    one = {"map": np.ones((1, 1)), "raw_map": np.ones((1, 1)), "target_map": np.ones((1, 1))}
    return {
        "dark": dark,
        "a spot": {"map": spot, "raw_map": spot, "target_map": spot[::-1].copy(), "lumens_per_watt": 1e30},
        "one pixel": {**one, "pixels": 1},
        "faint": {name: np.full((16, 16), 1e-30) for name in dark} | _square(1e-30),
        "wide": _square(1e12),
        "a mask below a pixel": {},
    }


@pytest.mark.parametrize("changes", first_by_day(3, extreme_lights().values()), ids=extreme_lights())
def test_a_page_shows_whatever_a_light_may_hold(changes: dict[str, Any]) -> None:
    lens = small_lens() if changes else small_lens(uniform_mm=1e-3)
    page = page_of(make_results(("evaluate",), lens, evaluate=changes))
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL).lower().split()


def test_a_page_shows_whatever_a_search_may_hold() -> None:
    steps = (1e30, 1e-30, 0.0, 1e30)
    names = ("cavity_clearance_mm", "wall_margin_mm", "radius_margin_mm")
    margins = dict.fromkeys(names, (-1e30, 1e30, 0.0, 1e-30))
    level = Level(level=0, functions=9, loss=(-1e30, *steps[1:]), nmse=steps, efficiency=steps, constraints=margins)
    outline = ((1e30, 0.0, 0.0), (-1e30, 0.0, 1e30))
    assert page_of(make_results(("design",), design={"history": (level,), "source_outline_mm": outline}))
