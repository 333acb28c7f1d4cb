"""A finished lens as the page of the studio takes it."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from travel_results import LM_PER_W, results, travel

from lensforge.addons.studio.folder_files import files_to_take
from lensforge.addons.studio.run_view import _files_of_lens_before, run_arrays, run_words
from lensforge.light.photometry_result import LUMINAIRE_FILES, TM33_FILE
from lensforge.report.exported_part import _PURPOSES, _purpose
from lensforge.report.folder import Run
from lensforge.shop.handover import DXF_FILE, PDF_FILE, PLATE_DXF_FILE, POINTS_FILE
from lensforge.shop.part_models import GLB_FILE, LAMPS_GLB_FILE, PLATE_GLB_FILE, RAYS_GLB_FILE


def test_the_studio_has_the_pictures_of_every_stop_behind_the_receivers(tmp_path):
    run = Run(results().lens, results().found, {}, {}, folder=tmp_path)
    arrays, texts = run_arrays(run, "sag"), run_words(run)
    *receivers, over = texts["receivers"]
    assert len(receivers) == len(run.light.receivers) and (over["width"], over["far"], over["unit"]) == (
        400.0,
        False,
        "lx",
    )
    assert over["stops"][2] == "0.25 mm, far: illuminance on the axis 375 ± 16 lx, full width at half maximum –"
    for index, stop in enumerate(travel().stops):
        assert arrays[f"light{len(receivers)}_{index}"] == pytest.approx(LM_PER_W * stop.map)
    for number, light in enumerate(run.light.receivers):
        assert arrays[f"light{number}"] == pytest.approx(LM_PER_W * light.map)
        assert arrays[f"target{number}"] == pytest.approx(LM_PER_W * light.target_map), "in the unit of the light"
    assert f"light{len(receivers)}" not in arrays and f"target{len(receivers)}" not in arrays


def test_every_file_that_a_stage_writes_for_others_can_be_taken_and_has_a_purpose_on_the_page(tmp_path: Path) -> None:
    written = {*LUMINAIRE_FILES.values(), TM33_FILE, GLB_FILE, LAMPS_GLB_FILE, PLATE_GLB_FILE, RAYS_GLB_FILE}
    written |= {DXF_FILE, PLATE_DXF_FILE, PDF_FILE, POINTS_FILE}
    assert all(map(_purpose, written))
    written |= {f"lens{suffix}" for suffix in _PURPOSES}
    for name in (*written, "design.npz", "checkpoint.bin"):
        (tmp_path / name).touch()
    assert set(files_to_take(tmp_path)) == written


@pytest.mark.parametrize(
    ("found", "report", "old"),
    [
        ((), "", {"lens.step", "lens.iesxml", "report.html"}),
        (("export",), "of abc123", {"lens.step", "lens.iesxml"}),  # its check may fail
        (("check", "photometry"), "of abc123", {"lens.step"}),
        (("export", "check"), "of another", {"lens.iesxml", "report.html"}),
        (("export", "check", "photometry"), "of abc123", set()),
    ],
)
def test_files_whose_stages_have_not_run_for_this_lens_are_of_one_before(
    found: tuple[str, ...], report: str, old: set[str], tmp_path: Path
) -> None:
    for name in ("lens.step", "lens.iesxml", "export.json", "lens.toml", "notes.md"):
        (tmp_path / name).write_text("x")
    (tmp_path / "report.html").write_text(report)
    run: Any = SimpleNamespace(folder=tmp_path, found=found, lens=SimpleNamespace(sha256="abc123"))
    assert set(_files_of_lens_before(run)) == old
