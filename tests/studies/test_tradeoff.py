"""Accuracy against time: rows of each series, page, screen and plot; the lens that is measured."""

import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from presets import FEW_STEPS
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.cli.conclusion import rows_of
from lensforge.cli.output import Block, print_screen
from lensforge.errors import InputError
from lensforge.report import tradeoff_study
from lensforge.report.folder import RunFolder
from lensforge.report.tradeoff import Tradeoff
from lensforge.report.tradeoff_study import _lens_in, run_tradeoff, tradeoff_figure
from lensforge.scene.lens import Lens, load_lens
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS

FEW = FEW_STEPS.replace("every_level", effort={"level_gain": 0.0})
SPEC = small_spec(base={"kind": "none"})
RAYS = 2**14


def small_lens():
    return Lens.double(random_surface(1, 3.0, 0.01, (9, 25)), random_surface(2, 6.0, 0.01, (9, 25)), SPEC, 0, "draft")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("tradeoff")
    small_lens().save(path / "lens.json")
    assert run_tradeoff(SPEC, path, most_rays=RAYS, accuracy=FEW) == Tradeoff.read(path)
    return path


def stated(light, **more):
    """The row of an evaluation, whose own numbers have their oracles in tests/stated; without its seconds."""
    figures = {"rays": light.rays, "nmse": light.nmse.model_dump(), "efficiency": light.efficiency.model_dump()}
    return {**figures, "noise_nmse": light.nmse_of_noise, "functions": None, "steps": None, "by_led": {}} | more


def rows_of_series(folder, series):
    rows = [row.model_dump() for row in Tradeoff.read(folder).series(series)]
    assert all(row.pop("seconds") > 0.0 for row in rows)
    return rows


def test_every_row_of_a_finished_lens_is_its_evaluation(folder):
    """By so many rays; and by the tables of each preset, with no more rays than are asked for."""
    by_rays = [stated(lf.evaluate(small_lens(), rays=count), series="rays", setting=f"{count} rays")
               for count in (2**12, 2**14)]  # fmt: skip
    assert rows_of_series(folder, "rays") == by_rays
    by_preset = [stated(lf.evaluate(replace(small_lens(), accuracy=name), rays=RAYS), series="presets", setting=name)
                 for name in PRESETS]  # fmt: skip
    assert rows_of_series(folder, "presets") == by_preset
    assert len({row["nmse"]["value"] for row in by_preset}) == 3
    errors = [row.error("efficiency") for row in Tradeoff.read(folder).series("rays")]
    assert errors == [row["efficiency"]["standard_error"] for row in by_rays] and errors[0] > errors[1] > 0.0


def test_every_row_of_a_search_is_the_lens_at_the_end_of_a_stage(folder):
    expected = []

    def keep(step):
        if step.steps_done == step.steps_total:
            grown = {"functions": step.functions, "steps": step.steps_done}
            light = lf.evaluate(step.lens(), rays=RAYS)
            expected.append(stated(light, series="search", setting=f"{step.functions} functions", **grown))

    result = lf.design(SPEC.with_automatic_levels(), accuracy=FEW, progress=keep)
    assert rows_of_series(folder, "search") == expected
    assert [row["functions"] for row in expected[:2]] == [9, 34]
    assert [row["steps"] for row in expected[:3]] == [4, 8, 14] and expected[-1]["steps"] == result.steps
    rows = Tradeoff.read(folder).series("search")
    assert [row.seconds for row in rows] == sorted(row.seconds for row in rows)
    assert [row.error("efficiency") for row in rows] == [1.0 - row.efficiency.value for row in rows]


def test_a_stage_has_the_seconds_of_the_search_so_far(monkeypatch):
    def search(_spec, _source, *, accuracy, progress):
        for done in (1, 2):
            progress(
                lf.Progress(
                    level=0, step=done, steps_done=done, steps_total=done, nmse=0.1, efficiency=0.9, functions=9,
                    level_done=True, seconds=100.0 * done, accuracy=accuracy, lens=small_lens,
                )
            )  # fmt: skip

    monkeypatch.setattr(tradeoff_study, "search_in_turn", search)
    rows = tradeoff_study._search_rows(SPEC, build_source(SPEC.source), 2**12, FEW)
    assert [row.seconds for row in rows] == [100.0, 200.0]


def test_page_and_screen_show_every_setting(folder, capsys):
    tradeoff, page = Tradeoff.read(folder), (folder / "tradeoff.html").read_text(encoding="utf-8")
    lines = [(fact.label, fact.value, fact.standard_error) for fact in tradeoff.facts[0].facts]
    assert lines == [(r.setting, r.nmse.value, r.nmse.standard_error) for r in tradeoff.rows if r.series != "rays"]
    assert not re.search(r'(src|href)="(?!data:|#)', page) and page.count("<svg") == 2
    print_screen([Block("Error of each preset on this scene", list(rows_of(tradeoff.facts)))])
    screen = capsys.readouterr().out
    for row in tradeoff.rows:
        assert f"<td>{row.setting}</td>" in page
        assert row.series == "rays" or f"{row.setting} {row.nmse}" in " ".join(screen.split())


def test_plots_have_errors_over_seconds(folder):
    tradeoff = Tradeoff.read(folder)
    for series in ("rays", "search"):
        rows = tradeoff.series(series)
        (line,) = tradeoff.plot(series=series, error="nmse").lines
        drawn = tradeoff_figure(tradeoff, series).axes[0].lines[0]
        for curve in (line, drawn):
            assert curve.get_xydata().tolist() == [[row.seconds, row.error("nmse")] for row in rows]
    with pytest.raises(InputError, match=r"^series = 'foo': must be one of .*rays"):
        tradeoff.plot(series="foo")
    with pytest.raises(InputError, match=r"^error = 'foo': must be one of .*nmse"):
        tradeoff.plot(error="foo")


def test_a_measured_source_has_no_more_rays_than_its_file():
    class Measured:
        ray_count = 5000

    assert tradeoff_study.ray_counts(2**16, [build_source(SPEC.source), Measured()]) == (4096, 5000)


@pytest.mark.parametrize(
    ("changes", "section"),
    [({"target__width_mm": 140.0}, "target"), ({"constraints__min_thickness_mm": 0.9}, "constraints"),
     ({"limits": [{"kind": "points", "unit": "relative", "at_mm": [[0.0, 0.0]], "at_least": 0.1}]}, "limits")],
)  # fmt: skip
def test_the_lens_of_another_scene_is_refused(folder, changes, section):
    other = small_spec(base={"kind": "none"}, **changes)
    with pytest.raises(InputError, match=rf"another \[{section}\]"):
        run_tradeoff(other, folder)


@pytest.mark.nightly("a draft; by day a lens is there")
def test_without_a_lens_a_draft_is_designed(tmp_path):
    heard = []
    spec = small_spec(base={"kind": "none"}, lens__symmetry="auto")

    def stop(message: str) -> None:
        heard.append(message)
        if message.startswith("rays"):
            raise StopIteration

    for _ in range(2):  # the second time the lens is there, and is that of its spec, whose symmetry it names
        with pytest.raises(StopIteration):
            run_tradeoff(spec, tmp_path, announce=stop)
    assert load_lens(tmp_path / "lens.json").accuracy == "draft"
    assert "draft" in heard[0] and len(heard) == 3


def test_a_lens_whose_picture_changed_since_is_not_measured(tmp_path):
    picture, folder = tmp_path / "arrow.png", tmp_path / "made"
    Image.fromarray(np.tri(32, dtype=np.uint8) * 255).save(picture)
    target = {"kind": "image", "file": str(picture), "width_mm": 100.0, "distance_mm": 100.0, "receiver_mm": 200.0}
    spec = small_spec(target=target, optimise={"steps_per_level": [1, 1], "rays": 256, "pixels": 16})
    lens = RunFolder(folder).write(lf.design(spec, accuracy="draft")).lens
    assert _lens_in(folder, spec, build_source(spec.source)) == lens
    Image.fromarray(np.tri(32, dtype=np.uint8)[::-1] * 255).save(picture)
    with pytest.raises(InputError, match="a file that its spec names has changed since"):
        run_tradeoff(spec, folder)


def test_rows_of_several_leds_and_kinds_are_of_the_worst_led_and_of_all_lamps():
    """The second LED has the larger error, the first less light. Two kinds are searched after the one lens for all."""
    disc = {"kind": "disc", "diameter_mm": 3.0, "position_mm": [0.4, 0.2, 0.0]}
    leds = [{"name": "one", "source": {"kind": "square", "side_mm": 0.5}}, {"name": "two", "source": disc}]
    steps = {"steps_per_level": [1, 1], "rays": 256, "pixels": 16}
    lens = replace(small_lens(), spec=small_spec(base={"kind": "none"}, source=None, sources=leds, optimise=steps))
    rows = lf.tradeoff(lens.spec, lens=lens, most_rays=2**12, accuracy=FEW).series("rays")
    light = lf.evaluate(lens, rays=2**12)
    one, two = (result.nmse for result in light.by_led.values())
    assert two.value > one.value and light.by_led["two"].efficiency.value > light.efficiency.value
    assert [(row.nmse, row.efficiency) for row in rows] == [(two, light.by_led["one"].efficiency)]
    assert rows[0].by_led["one"].nmse == one and rows[0].facts.title == "4096 rays, worst of 2 LEDs"
    lamps = {"kind": "table", "places_mm": [[-20.0, 3.0], [18.0, -2.0]], "kinds": ["wide", "narrow"]}
    spec = small_spec(base={"kind": "none"}, lamps=lamps, optimise=steps)
    narrow = {**small_lens().surfaces, "outer": random_surface(5, 6.5, 0.02, (9, 25))}
    kinds = replace(small_lens(), spec=spec, others={"narrow": narrow})
    tradeoff = lf.tradeoff(spec, lens=kinds, most_rays=2**12, accuracy=FEW)
    assert tradeoff.series("rays")[0].nmse == lf.evaluate(kinds, rays=2**12).nmse
    settings = [row.setting for row in tradeoff.series("search")]
    assert settings[0] == "9 functions" and settings[-1].endswith("functions, 2 kinds")
