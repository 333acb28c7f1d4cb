"""Archives of arrays in a result folder that claim, hide or lack something: one line, at once, in little memory."""

import hashlib
import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from refusals import changed, refusal_in_little_memory
from result_folders import evaluate_arrays

from lensforge.light.evaluation_result import Light

pytestmark = pytest.mark.usefixtures("no_warnings")


def with_archive(folder: Path, content: bytes) -> None:
    """Put ``content`` in place of ``evaluate.npz``, with its hash in the record."""
    (folder / "evaluate.npz").write_bytes(content)
    changed(folder / "evaluate.json", "arrays_sha256", hashlib.sha256(content).hexdigest())


def archive(members: dict[str, bytes]) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in members.items():
            packed.writestr(f"{name}.npy", content)
    return file.getvalue()


def member(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array(file, array, allow_pickle=True)
    return file.getvalue()


def whole_members() -> dict[str, bytes]:
    return {name: member(values) for name, values in evaluate_arrays().items()}


def claims(shape: str, dtype: str = "<f8") -> bytes:
    """A member whose header claims any shape, with the numbers of one row."""
    header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + bytes(128)


def bomb() -> bytes:
    """An archive of 3 MB whose map has 400 million zeros."""
    header = claims("(20000, 20000)")[:-128]
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
        for name, content in whole_members().items():
            if name != "map":
                packed.writestr(f"{name}.npy", content)
        with packed.open("map.npy", "w", force_zip64=True) as stream:
            stream.write(header)
            block = bytes(2**22)
            for _ in range(160):  # 640 MiB, enough to tell
                stream.write(block)
    return file.getvalue()


ARCHIVES: dict[str, Callable[[], bytes]] = {
    "empty": lambda: b"",
    "truncated": lambda: archive(whole_members())[:-300],
    "bomb": bomb,
    "claims much": lambda: archive({**whole_members(), "map": claims("(1000000, 1000000)")}),
    "claims less than nothing": lambda: archive({**whole_members(), "map": claims("(-16, -1)")}),
    "claims a number of 3,000 digits": lambda: archive({**whole_members(), "map": claims("(1" + "0" * 3000 + ",)")}),
    "objects": lambda: archive({**whole_members(), "map": member(np.array([{"a": 1}] * 4, dtype=object))}),
    "text": lambda: archive({**whole_members(), "map": member(np.full((16, 16), "x"))}),
    "complex": lambda: archive({**whole_members(), "map": member(np.ones((16, 16), complex))}),
    "one pixel": lambda: archive({**whole_members(), "map": member(np.ones((1, 1)))}),
    "other sizes": lambda: archive({**whole_members(), "axis_mm": member(np.linspace(-1.0, 1.0, 8))}),
    "too many pixels": lambda: archive({name: member(np.zeros(5000)) for name in evaluate_arrays()}),
    "beyond any light": lambda: archive({**whole_members(), "map": member(np.full((16, 16), 1e300))}),
    "below any light": lambda: archive({**whole_members(), "map": member(np.full((16, 16), 5e-324))}),
    "negative light": lambda: archive({**whole_members(), "map": member(np.full((16, 16), -1.0))}),
    "positions that turn round": lambda: archive({**whole_members(), "axis_mm": member(np.arange(16.0)[::-1].copy())}),
    "many members": lambda: archive({**whole_members(), **{f"x{number}": b"" for number in range(3000)}}),
}


@pytest.mark.parametrize("make", ARCHIVES.values(), ids=ARCHIVES)
def test_an_archive_of_anything_is_one_line(folder: Path, make: Callable[[], bytes]) -> None:
    with_archive(folder, make())
    message = refusal_in_little_memory(lambda: Light.read(folder))
    assert "evaluate" in message and "run `lensforge evaluate` again" in message


@pytest.mark.parametrize("how", [np.asfortranarray, lambda values: values.astype(">f8")], ids=["columns", "big-endian"])
def test_the_order_of_bytes_and_rows_changes_nothing(folder: Path, how: Callable[[np.ndarray], np.ndarray]) -> None:
    before = Light.read(folder)
    with np.load(folder / "evaluate.npz") as arrays:
        with_archive(folder, archive({name: member(how(arrays[name])) for name in arrays}))
    assert Light.read(folder) == before
    assert Light.read(folder).sha256 == before.sha256
