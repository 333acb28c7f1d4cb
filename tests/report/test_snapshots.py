import shutil
from dataclasses import replace

import numpy as np
import pytest
from judgements import judge_as
from result_folders import make_results, page_of, small_lens
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.report.lens_figures import snapshot_figure
from lensforge.report.snapshots import FOLDER, Snapshots, load_snapshots, outer_slope
from lensforge.search.optimiser import search
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS, SearchEffort


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """A folder with the snapshots of a small design, and the design."""
    folder, spec = tmp_path_factory.mktemp("design"), small_spec()
    (folder / "snapshots").mkdir()
    (folder / "snapshots" / "level-9.npz").write_bytes(b"of an earlier design")
    (folder / "snapshots" / "notes.txt").write_text("the user's own", encoding="utf-8")
    observer = Snapshots(spec, folder)
    return folder, search(spec, build_source(spec.source), accuracy="draft", progress=observer.on_step)


def test_every_level_leaves_a_picture_and_its_numbers(taken):
    folder, result = taken
    names = sorted(path.name for path in (folder / "snapshots").iterdir())
    pictures = [f"level-{level}.{suffix}" for level in (1, 2) for suffix in ("json", "npz", "png")]
    assert names == [*pictures, "notes.txt"]
    for path in (folder / "snapshots").glob("*.png"):
        assert path.read_bytes().startswith(b"\x89PNG")
    assert [(each.level, each.functions, each.step) for each in load_snapshots(folder, result.lens)] == [
        (1, 9, 4),
        (2, 34, 8),
    ]


def test_the_last_level_is_the_finished_lens(taken):
    folder, result = taken
    surface, slope = outer_slope(result.lens)
    last = load_snapshots(folder, result.lens)[-1]
    assert np.array_equal(last.surface_mm, surface)
    assert np.array_equal(last.slope, slope)
    assert not np.allclose(load_snapshots(folder, result.lens)[0].slope, slope), "the level before was another"


def test_the_slope_is_the_derivative_of_the_radius():
    surface, slope = outer_slope(small_lens(bump_mm=1.0))
    radius = np.linalg.norm(surface, axis=-1)
    theta = np.arccos(np.clip(surface[..., 2] / radius, -1.0, 1.0))
    differences = (radius[2:] - radius[:-2]) / (theta[2:] - theta[:-2])
    assert slope[1:-1] == pytest.approx(differences, abs=2e-3 * np.abs(slope).max())
    assert np.abs(slope).max() > 0.1


def test_the_light_that_a_snapshot_holds_is_what_its_efficiency_says(taken):
    for each in load_snapshots(taken[0], taken[1].lens):
        area = each.width * each.height * 1e-6 / each.irradiance.size
        assert each.irradiance.sum() * area == pytest.approx(each.efficiency, rel=1e-9), "of 1 W"


def test_snapshots_change_nothing_in_the_design(taken):
    spec = small_spec()
    plain = search(spec, build_source(spec.source), accuracy="draft")
    assert np.array_equal(plain.lens.outer.weights_mm, taken[1].lens.outer.weights_mm)


def test_a_resumed_design_keeps_the_levels_that_it_had(taken):
    folder, result = taken
    Snapshots(small_spec(), folder, resume=True)
    assert len(load_snapshots(folder, result.lens)) == 2


def test_snapshots_of_automatic_levels_end_in_the_finished_lens(tmp_path, monkeypatch):
    """The second level is left out, and after the last stage the search goes back to the best lens."""
    effort = SearchEffort(25, (4, 6), (256, 512), 512, 0.1, 0.05)
    monkeypatch.setitem(PRESETS, "draft", replace(PRESETS["draft"], effort=effort))
    judge_as(monkeypatch, 1.0, 0.5, 0.51, 0.49, 0.4, 0.45)
    changes = {"optimise__steps_per_level": None, "optimise__rays": None, "target__uniform_mm": None}
    spec = small_spec(lens__levels="auto", **changes)
    observer = Snapshots(spec, tmp_path)
    result = search(spec, build_source(spec.source), accuracy="draft", progress=observer.on_step)
    assert result.steps == 4 + 4 + 4 + 6 + 6 and result.lens.basis.levels == (9,)
    found = load_snapshots(tmp_path, result.lens)
    assert [(each.level, each.functions, each.step) for each in found] == [(1, 9, 24)]
    assert np.array_equal(found[-1].surface_mm, outer_slope(result.lens)[0])


def test_levels_can_be_drawn_on_one_scale(taken):
    each = load_snapshots(taken[0], taken[1].lens)[0]
    figure = snapshot_figure(each.surface_mm, each.slope, each.irradiance, each.chart, steepest=9.0, top=70.0)
    slopes, light = figure.axes[1], figure.axes[3]
    assert slopes.get_xlim() == (-9.0, 9.0)
    assert light.get_xlim() == (0.0, 70.0)


@pytest.mark.usefixtures("undrawn")
def test_the_report_shows_them(taken, tmp_path):
    folder, result = taken
    results = make_results((), lens=result.lens)
    without = page_of(results, tmp_path).count("<svg")
    markup = page_of(results, folder)
    assert markup.count("<svg") == without + 2
    assert "Level 2: 34 functions" in markup


def test_those_of_another_design_are_not_shown(taken):
    assert load_snapshots(taken[0], small_lens()) == []


def test_those_of_another_version_are_not_shown(taken, tmp_path):
    copied = tmp_path / FOLDER
    shutil.copytree(taken[0] / FOLDER, copied)
    assert len(load_snapshots(tmp_path, taken[1].lens)) == 2
    record = copied / "level-1.json"
    record.write_text(record.read_text(encoding="utf-8").replace("lensforge-level-3", "lensforge-level-2"))
    assert load_snapshots(tmp_path, taken[1].lens) == []


@pytest.mark.parametrize("file", ["level-1.json", "level-1.npz"])
def test_a_damaged_snapshot_is_one_line(taken, tmp_path, file):
    shutil.copytree(taken[0] / FOLDER, tmp_path / FOLDER)
    (tmp_path / FOLDER / file).write_bytes(b"nothing")
    with pytest.raises(InputError, match=rf"{file}: .*") as caught:
        load_snapshots(tmp_path, taken[1].lens)
    assert "\n" not in str(caught.value)
