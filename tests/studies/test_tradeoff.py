"""Accuracy against time: rows of each series, page, screen and plot; the lens that is measured."""

import re

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


def test_an_evaluation_by_rays_is_that_of_the_lens_and_its_error_falls(folder):
    rows = Tradeoff.read(folder).series("rays")
    assert [row.rays for row in rows] == [2**12, 2**14]
    light = lf.evaluate(small_lens(), rays=RAYS)
    assert (rows[-1].nmse, rows[-1].efficiency) == (light.nmse, light.efficiency)
    assert rows[0].noise_nmse > 3.0 * rows[1].noise_nmse > 0.0
    assert rows[0].error("efficiency") > rows[1].error("efficiency") > 0.0
    assert [row.setting for row in Tradeoff.read(folder).series("presets")] == list(PRESETS)


def test_the_stages_of_a_search_are_those_of_the_search(folder):
    rows = Tradeoff.read(folder).series("search")
    result = lf.design(SPEC.with_automatic_levels(), accuracy=FEW)
    assert [row.functions for row in rows[:2]] == [9, 34]
    assert [row.steps for row in rows[:3]] == [4, 8, 14] and rows[-1].steps == result.steps
    assert [row.seconds for row in rows] == sorted(row.seconds for row in rows)
    efficiency = lf.evaluate(result.lens, rays=RAYS).efficiency.value
    assert any(row.efficiency.value == pytest.approx(efficiency, abs=1e-3) for row in rows)


def test_a_stage_has_the_seconds_of_the_search_so_far(monkeypatch):
    def search(_spec, _source, *, accuracy, progress):
        for done in (1, 2):
            progress(
                lf.Progress(
                    level=0, step=done, steps_done=done, steps_total=done, nmse=0.1, efficiency=0.9, functions=9,
                    level_done=True, seconds=100.0 * done, accuracy=accuracy, lens=small_lens,
                )
            )  # fmt: skip

    monkeypatch.setattr(tradeoff_study, "search", search)
    rows = tradeoff_study._search_rows(SPEC, build_source(SPEC.source), 2**12, FEW)
    assert [row.seconds for row in rows] == [100.0, 200.0]


def test_page_and_screen_show_every_setting(folder, capsys):
    found, page = Tradeoff.read(folder), (folder / "tradeoff.html").read_text(encoding="utf-8")
    assert not re.search(r'(src|href)="(?!data:|#)', page) and page.count("<svg") == 2
    print_screen([Block("Error of each preset on this scene", list(rows_of(found.facts)))])
    screen = capsys.readouterr().out
    for row in found.rows:
        assert f"<td>{row.setting}</td>" in page
        assert row.series == "rays" or f"{row.setting} {row.nmse}" in " ".join(screen.split())


def test_plots_have_errors_over_seconds(folder):
    found = Tradeoff.read(folder)
    for series in ("rays", "search"):
        rows = found.series(series)
        (line,) = found.plot(series=series, error="nmse").lines
        drawn = tradeoff_figure(found, series).axes[0].lines[0]
        for one in (line, drawn):
            assert one.get_xydata().tolist() == [[row.seconds, row.error("nmse")] for row in rows]
    with pytest.raises(InputError, match=r"^series = 'foo': must be one of .*rays"):
        found.plot(series="foo")
    with pytest.raises(InputError, match=r"^error = 'foo': must be one of .*nmse"):
        found.plot(error="foo")


def test_a_measured_source_has_no_more_rays_than_its_file():
    class Measured:
        ray_count = 5000

    assert tradeoff_study.ray_counts(2**16, Measured()) == (4096, 5000)


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

    def stop(words: str) -> None:
        heard.append(words)
        if words.startswith("rays"):
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
