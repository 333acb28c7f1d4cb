"""Pictures that another command has drawn: the same, of the same results alone, and never a reason to fail."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from part_files import make_stray
from result_folders import STAGES, make_results, small_lens

from lensforge.report.lens_page import _PICTURES, _pictures
from lensforge.results import files
from lensforge.results.files import keep_what_is_made, made_once


@contextmanager
def kept_in(home: Path) -> Iterator[Path]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(home))
        keep_what_is_made()
    yield home / "lensforge" / "made"
    files._homes.clear()


def test_a_page_has_the_same_pictures_by_all_results_and_as_they_were_kept(tmp_path: Path) -> None:
    lens = small_lens()
    results = make_results((*STAGES, "stray"), lens, stray=make_stray(lens))
    drawn = {name: draw(results) for name, (draw, _) in _PICTURES.items()}
    assert all(drawn.values())
    with kept_in(tmp_path) as folder:
        for _ in range(2):
            found = _pictures(results)
            assert {name: found[name] for name in drawn} == drawn
        assert len(list(folder.iterdir())) == len(drawn)
        for number, path in enumerate(folder.iterdir()):
            path.write_bytes(path.read_bytes()[:-100] if number % 2 else b"")
        assert _pictures(results)["gaps"] == drawn["gaps"], "of a damaged file it is made again"


def test_what_is_made_of_something_else_or_does_not_last_is_made_anew(tmp_path: Path) -> None:
    made: list[str] = []

    def make() -> int:
        made.append("")
        return len(made)

    assert [made_once(["a"], make) for _ in range(2)] == [1, 2], "a script keeps nothing"
    with kept_in(tmp_path):
        assert [made_once([each], make) for each in ("a", "a", "b", "a")] == [3, 3, 4, 3]
        assert [made_once(["c"], make, lambda found: found > 5) for _ in range(3)] == [5, 6, 6]
    with kept_in(Path("/dev/null")):
        assert [made_once(["a"], make) for _ in range(2)] == [7, 8]
