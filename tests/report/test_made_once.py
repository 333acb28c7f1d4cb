"""Pictures that another command has drawn: the same, of the same results alone, and never a reason to fail."""

import hashlib
import json
import os
import pickle
import random
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from part_files import make_stray
from result_folders import STAGES, face_maps, make_results, small_lens
from travel_results import travel

from lensforge.report.lens_page import _PICTURES, _pictures
from lensforge.report.page import PagePicture
from lensforge.results import made_cache
from lensforge.results.made_cache import keep_what_is_made, made_once
from lensforge.shop.check_measures import FaceFaults


@contextmanager
def kept_in(home: Path) -> Iterator[Path]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(home))
        keep_what_is_made()
    yield home / "lensforge" / "made"
    made_cache._homes.clear()


def test_a_page_has_the_same_pictures_by_all_results_and_as_they_were_kept(tmp_path: Path) -> None:
    lens = small_lens()
    kinds = np.where(np.isnan(face_maps()["sag_mm"]), np.nan, 1.0)
    faults = (FaceFaults(face="outer", places_mm={}, kinds=kinds),)
    results = make_results(
        (*STAGES, "stray"), lens, stray=make_stray(lens), check={"faults": faults}, evaluate={"travel": travel()}
    )
    drawn = {name: draw(results) for name, (draw, _, _) in _PICTURES.items()}
    assert all(drawn.values())
    with kept_in(tmp_path) as folder:
        for _ in range(2):
            pictures = _pictures(results)
            assert {name: pictures[name] for name in drawn} == drawn
        assert len(list(folder.iterdir())) == len(drawn)
        for number, path in enumerate(folder.iterdir()):
            path.write_bytes(path.read_bytes()[:-100] if number % 2 else b"")
        assert _pictures(results)["gaps"] == drawn["gaps"], "of a damaged file it is made again"


def test_what_is_made_of_something_else_or_does_not_last_is_made_anew(tmp_path: Path) -> None:
    made: list[str] = []

    def make() -> int:
        made.append("")
        return len(made)

    assert [made_once(["a"], make, int) for _ in range(2)] == [1, 2], "a script keeps nothing"
    with kept_in(tmp_path):
        assert [made_once([key], make, int) for key in ("a", "a", "b", "a")] == [3, 3, 4, 3]
        assert [made_once(["c"], make, int, lambda number: number > 5) for _ in range(3)] == [5, 6, 6]
    with kept_in(Path("/dev/null")):
        assert [made_once(["a"], make, int) for _ in range(2)] == [7, 8]


@pytest.fixture
def entry(tmp_path: Path) -> Iterator[Path]:
    """A list of pictures that is kept."""
    with kept_in(tmp_path) as folder:
        assert made_once(["k"], lambda: PICTURES, list[PagePicture]) == PICTURES
        (path,) = folder.iterdir()
        yield path


PICTURES = [PagePicture("<svg>Δ" + "x" * 500 + "</svg>", "title", "a caption"), PagePicture("", "", "")]
AGAIN = [PagePicture("made", "anew", "")]


def kept_or_made() -> list[PagePicture]:
    return made_once(["k"], lambda: AGAIN, list[PagePicture], lambda _: False)


def test_no_flipped_bit_stands_in_a_page(entry: Path) -> None:
    whole, chance = entry.read_bytes(), random.Random(0)
    assert kept_or_made() == PICTURES
    for _ in range(500):
        damaged = bytearray(whole)
        for _ in range(chance.choice((1, 3))):
            damaged[chance.randrange(len(damaged))] ^= 1 << chance.randrange(8)
        entry.write_bytes(damaged)
        assert kept_or_made() == (PICTURES if bytes(damaged) == whole else AGAIN)


class _Runs:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, ("run by a cached picture",)


def test_nothing_that_a_file_holds_is_run_and_an_entry_of_another_place_is_none(
    entry: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole, content = entry.read_bytes(), json.dumps([{"svg": "another", "title": "", "caption": ""}]).encode()
    of_its_own = hashlib.sha256(content).hexdigest().encode() + b"\n" + content
    for other in (pickle.dumps(_Runs()), b"", whole[:-1], whole + b" ", of_its_own, b"[]", whole[65:]):
        entry.write_bytes(other)
        assert kept_or_made() == AGAIN
    assert not (tmp_path / "run by a cached picture").exists()
    entry.write_bytes(whole)
    assert made_once(["l"], lambda: AGAIN, list[PagePicture]) == AGAIN
    other = next(path for path in entry.parent.iterdir() if path != entry)
    entry.write_bytes(other.read_bytes())
    assert kept_or_made() == AGAIN, "made of something else, though whole"
    entry.unlink()
    made_once(["k"], lambda: 7, int)
    assert kept_or_made() == AGAIN, "of another kind"


@pytest.mark.skipif(sys.platform == "win32", reason="no pipes with names there")
def test_regular_files_alone_are_read_and_nobody_else_looks_into_the_folder(entry: Path, tmp_path: Path) -> None:
    assert entry.parent.stat().st_mode & 0o777 == 0o700
    whole = entry.read_bytes()
    signal.alarm(60)  # a pipe has no end
    for make in (os.mkfifo, os.mkdir, lambda path: path.symlink_to("/dev/zero")):
        entry.unlink() if entry.is_file() or entry.is_fifo() else None
        make(entry)
        assert kept_or_made() == AGAIN
        entry.rmdir() if entry.is_dir() else entry.unlink()
    (tmp_path / "elsewhere").write_bytes(whole)
    entry.symlink_to(tmp_path / "elsewhere")
    assert kept_or_made() == AGAIN
    signal.alarm(0)
    entry.unlink()
    entry.parent.chmod(0o755)  # of an earlier version
    made_once(["k"], lambda: PICTURES, list[PagePicture])
    assert entry.parent.stat().st_mode & 0o777 == 0o700 and kept_or_made() == PICTURES


def test_an_entry_larger_than_any_page_is_not_read(entry: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(made_cache, "_MOST_BYTES", len(entry.read_bytes()) - 1)
    assert kept_or_made() == AGAIN
