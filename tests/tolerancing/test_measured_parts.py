"""Measured parts: kept at an interrupt, the same bits after it, nothing of another study."""

import numpy as np
import pytest
from parts import study_of

from lensforge.errors import Cancelled, InputError
from lensforge.tolerancing.measured_parts import MeasuredParts, Threads


def _parts(study, file=None, progress=None) -> MeasuredParts:
    return MeasuredParts(study, Threads(study), file, progress)


def test_an_interrupted_study_goes_on_to_the_same_bits(tmp_path) -> None:
    study, file = study_of(rays=256), tmp_path / "parts.npz"
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
    assert len(_parts(study_of(rays=256), file).known) == 4
    for other in (study_of(rays=512), study_of(rays=256, seed=1), study_of({"gap_mm": 0.1}, rays=256)):
        assert len(_parts(other, file).known) == 0


def test_a_damaged_file_is_one_line(tmp_path) -> None:
    file = tmp_path / "parts.npz"
    file.write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"cannot be read .* delete it to begin again"):
        _parts(study_of(rays=256), file)


def test_threads_do_not_change_a_bit() -> None:
    import torch

    study, before = study_of(rays=512), torch.get_num_threads()
    found = []
    try:
        for threads in (1, 2):
            torch.set_num_threads(threads)
            found.append(_parts(study_of(rays=512)).of(range(6)))
    finally:
        torch.set_num_threads(before)
    assert (found[0] == found[1]).all()
    assert np.isfinite(found[0]).all()
    assert study.names[0] == "nmse"
