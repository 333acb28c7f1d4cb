"""Measured parts: kept at an interrupt, the same bits after it, nothing of another study."""

import json
import os
from dataclasses import fields, replace

import numpy as np
import pytest
from nightly import first_by_day
from parts import lens_with, study_of
from presets import FEW

from lensforge.errors import Cancelled, InputError
from lensforge.made import measured_parts
from lensforge.made.measured_parts import KeptParts, MeasuredParts
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.made.yield_study import measure_yield
from lensforge.results.stage_result import with_checksum


def _parts(study, file=None, progress=None) -> MeasuredParts:
    return MeasuredParts(study, None, KeptParts.of(file, study), progress)


def test_an_interrupted_study_goes_on_to_the_same_bits(tmp_path) -> None:
    study = study_of(rays=256)
    file = tmp_path / "parts.npz"
    whole = _parts(study).of(range(20))
    with pytest.raises(Cancelled):
        _parts(study, file, lambda done, expected: done < 8).of(range(20))
    measured = []
    again = _parts(study_of(rays=256), file, lambda done, expected: measured.append(done))
    assert (again.of(range(20)) == whole).all()
    assert measured == [16, 20]  # the first eight were kept
    scaled = again.of(range(3), {"gap_mm": 2.0})
    assert not (scaled == whole[:3]).all()
    assert (again.of(range(3), {"gap_mm": 1.0}) == whole[:3]).all()


def test_parts_of_another_study_do_not_count(tmp_path) -> None:
    file = tmp_path / "parts.npz"
    _parts(study_of(rays=256), file).of(range(4))
    assert len(_parts(study_of(rays=256), file).kept.known) == 4
    designed = PartStudy(replace(study_of(rays=256).recipe, designed_rays=512))
    for other in (study_of(rays=256, seed=1), study_of({"gap_mm": 0.1}, rays=256), designed):
        assert len(_parts(other, file).kept.known) == 0


def test_parts_by_other_rays_are_kept_beside_each_other(tmp_path) -> None:
    """A study begins with few rays and may take more: begun again, it must not lose those of more."""
    file = tmp_path / "parts.npz"
    measured = []
    few = _parts(study_of(rays=256), file)
    first = few.of(range(4))
    second = few.with_rays(512).of(range(4))
    assert not (first == second).all()
    again = _parts(study_of(rays=256), file, lambda done, expected: measured.append(done))
    assert (again.of(range(4)) == first).all()
    assert (again.with_rays(512).of(range(4)) == second).all()
    assert again.with_rays(256) is again
    assert measured == []


def test_a_study_that_chooses_its_rays_goes_on_after_an_interrupt(tmp_path) -> None:
    fewer = FEW.replace("fewer", studies={"part_rays": (64, 256)})
    lens = lens_with({"gap_mm": 0.1}, accuracy=fewer)
    file = tmp_path / "parts.npz"
    measured = []
    whole = measure_yield(lens, parts=40, with_budget=False)
    assert whole.rays == 256

    def stop(done: int, expected: int) -> bool:
        measured.append(done)
        return len(measured) < 12

    with pytest.raises(Cancelled):
        measure_yield(lens, parts=40, with_budget=False, file=file, progress=stop)
    before = len(measured)
    again = measure_yield(lens, parts=40, with_budget=False, file=file, progress=lambda done, _: measured.append(done))
    assert again.model_copy(update={"seconds": whole.seconds}) == whole
    assert 0 < len(measured) - before < before


def test_a_damaged_file_is_one_line(tmp_path) -> None:
    file = tmp_path / "parts.npz"
    _parts(study_of(rays=256), file).of(range(2))
    whole = file.read_bytes()
    for content in (b"", b"no archive", whole[: len(whole) // 2], whole[:-30], whole.replace(b"rays", b"rats")):
        file.write_bytes(content)
        with pytest.raises(InputError, match=r"no parts of a study .* delete it to begin again") as error:
            _parts(study_of(rays=256), file)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("rewritten", first_by_day(1, [False, True], "other numbers"))
@pytest.mark.parametrize("name", ["rays", "numbers", "scales", "values", "head"])
def test_other_numbers_than_those_that_were_measured_are_refused(tmp_path, name: str, rewritten: bool) -> None:
    """One entry of each array is changed, or all hashes with it: then the numbers must still be those of a study."""
    study = study_of(rays=256)
    file = tmp_path / "parts.npz"
    _parts(study, file).of(range(3), {"gap_mm": 2.0})
    with np.load(file) as archive:
        arrays = {key: archive[key].copy() for key in archive.files}
    if name == "head":
        arrays["head"][-3] ^= 1
    elif rewritten:
        arrays[name] = arrays[name][:-1]
        head = json.loads(arrays["head"].tobytes()) | {"sha256": measured_parts._sha256(arrays)}
        arrays["head"] = np.frombuffer(json.dumps(with_checksum(head)).encode(), dtype=np.uint8)
    else:
        arrays[name].flat[0] += 1
    np.savez(file, **arrays)
    with pytest.raises(InputError, match="delete it to begin again"):
        _parts(study, file)


def test_a_pipe_and_a_device_are_no_parts(tmp_path) -> None:
    study = study_of(rays=256)
    os.mkfifo(tmp_path / "parts.npz")  # whose reading would not end
    (tmp_path / "device.npz").symlink_to("/dev/zero")
    (tmp_path / "nowhere.npz").symlink_to(tmp_path / "none")
    with (tmp_path / "large.npz").open("wb") as file:
        file.truncate(2**30)
    for name, message in {
        "parts": "a pipe",
        "device": "a device",
        "nowhere": "no such file",
        "large": "1024 MiB",
    }.items():
        with pytest.raises(InputError, match=message):
            _parts(study, tmp_path / f"{name}.npz")


def test_threads_do_not_change_a_bit() -> None:
    import torch

    study = study_of(rays=512)
    before = torch.get_num_threads()
    results = []
    try:
        for threads in (1, 2):
            torch.set_num_threads(threads)
            results.append(_parts(study_of(rays=512)).of(range(6)))
    finally:
        torch.set_num_threads(before)
    assert (results[0] == results[1]).all()
    assert np.isfinite(results[0]).all()
    assert study.names[0] == "nmse"


def test_progress_counts_the_parts_that_are_asked_for() -> None:
    """The study as specified, and then the same parts with a tolerance doubled, as the budget asks for them."""
    seen: list[tuple[int, int]] = []
    parts = _parts(study_of(rays=256), None, lambda done, asked: seen.append((done, asked)))
    parts.of(range(20))
    parts.of(range(3), {"gap_mm": 2.0})
    assert seen == [(8, 20), (16, 20), (20, 20), (3, 3)]


def test_a_worker_keeps_no_study_of_another_recipe() -> None:
    """Each field of a recipe alone makes it another one; of the same recipe the study stays."""
    first = Recipe(lens_with({"index": 1e-3}), 4, 256, 0, 512)
    other = {"lens": lens_with({"index": 2e-3}), "parts": 5, "rays": 512, "seed": 1, "designed_rays": 1024}
    assert set(other) == {field.name for field in fields(Recipe)}
    kept = measured_parts._study(first)
    for name, value in other.items():
        changed = measured_parts._study(replace(first, **{name: value})).recipe
        assert getattr(changed, name) == value and changed != kept.recipe, name
        assert measured_parts._study(first).recipe == first
