"""Damaged files of a result folder, each refused in one line."""

import json
import re

import numpy as np
import pytest
from result_folders import (
    check_arrays,
    make_folder,
    stored_arrays,
)

from lensforge.errors import InputError
from lensforge.report.stored import load_results
from lensforge.results.stage_result import with_checksum


@pytest.mark.parametrize("stage", ["evaluate", "check", "verify"])
def test_missing_arrays_are_one_line(tmp_path, stage):
    make_folder(tmp_path)
    (tmp_path / f"{stage}.npz").unlink()
    with pytest.raises(InputError, match=rf"{stage}\.npz: no such file; run `lensforge {stage}` again"):
        load_results(tmp_path)


def changed(folder, file, *path, value=None, resealed=True):
    """Take the entry at ``path`` out of a JSON file, or give it another value; ``resealed``: under a right checksum."""
    content = json.loads((folder / file).read_text(encoding="utf-8"))
    inner = content
    for name in path[:-1]:
        inner = inner[name]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    (folder / file).write_text(json.dumps(with_checksum(content) if resealed else content), encoding="utf-8")


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("lens.json", "{}"),
        ("design.json", '{"steps": 7, "hist'),
        ("design.json", "[1, 2]"),
        ("verify.json", "\x00\x01"),
    ],
)
def test_a_file_that_is_no_record_is_one_line(tmp_path, file, text):
    (make_folder(tmp_path) / file).write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(file)) as caught:
        load_results(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("file", "path", "value"),
    [
        ("design.json", ("history", 0, "nmse"), None),
        ("evaluate.json", ("receivers", 0, "width"), 0.0),
        ("evaluate.json", ("receivers", 0, "efficiency"), None),
        ("evaluate.json", ("receivers", 0, "efficiency", "value"), "bad"),
        ("export.json", ("form_error_nm", "max"), None),
        ("check.json", ("inner", "cutter"), None),
    ],
)
def test_a_broken_record_is_one_line(tmp_path, file, path, value):
    changed(make_folder(tmp_path), file, *path, value=value)
    with pytest.raises(InputError, match=re.escape(file)) as caught:
        load_results(tmp_path)
    assert "\n" not in str(caught.value)
    assert ".".join(map(str, path)) in str(caught.value)


@pytest.mark.parametrize(("file", "entry"), [("evaluate.json", "flux"), ("verify.json", "deviation_mm")])
def test_an_entry_that_follows_from_others_is_in_the_checksum(tmp_path, file, entry):
    changed(make_folder(tmp_path), file, entry, resealed=False)
    with pytest.raises(InputError, match=rf"{re.escape(file)}: content_sha256: .*run `lensforge"):
        load_results(tmp_path)


BROKEN_ARRAYS = {
    "evaluate.npz": [
        {key: value for key, value in stored_arrays().items() if key != "receivers.0.target_map"},
        {**stored_arrays(), "receivers.0.raw_map": np.ones((3, 4))},
        {**stored_arrays(), "receivers.0.map": np.full((16, 16), np.nan)},
        {**stored_arrays(), "receivers.1.map": np.ones((16, 16))},
        {**stored_arrays(), "receivers.0.target_map": np.full((16, 16), "text")},
    ],
    "check.npz": [
        {**check_arrays(), "inner_sag_mm": np.full((21, 21), np.inf)},
        {**check_arrays(), "inner_sag_mm": np.array(1.0)},
    ],
    "verify.npz": [{"irradiance": np.ones((8, 8)), "design_irradiance": np.full((8, 8), np.inf)}],
}


@pytest.mark.parametrize(("file", "arrays"), [(file, case) for file, cases in BROKEN_ARRAYS.items() for case in cases])
def test_broken_arrays_are_one_line(tmp_path, file, arrays):
    np.savez(make_folder(tmp_path) / file, **arrays)
    with pytest.raises(InputError, match=re.escape(file.removesuffix(".npz"))) as caught:
        load_results(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kept", [0, 10, 900])
def test_a_truncated_npz_is_one_line(tmp_path, kept):
    path = make_folder(tmp_path) / "evaluate.npz"
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match=r"evaluate\.npz"):
        load_results(tmp_path)
