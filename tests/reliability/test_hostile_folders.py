"""Result folders in which somebody has been at work: each command reads them, or says in one line why not.

Files that are swapped, cut, linked, sparse, pipes, folders or somebody else's; figures that were forged under a right
checksum, with and without run.json. LENSFORGE_FUZZ=10: ten times as many.
"""

import hashlib
import json
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from made_once import copied
from nightly import scaled
from refusals import one_line

import lensforge as lf
from lensforge.report.folder import existing, opened
from lensforge.report.pipeline import write_report
from lensforge.results.stage_result import with_checksum

pytestmark = [
    pytest.mark.usefixtures("undrawn"),
    pytest.mark.skipif(os.name != "posix", reason="makes pipes and links"),
]

Chance = random.Random
SECRET = b"what is in another folder is nobody's business\n"
_WORDS = (0, 1, -1, 0.5, 1e-9, 1e30, 1e308, 10**400, True, False, None, "", "x", [], {}, [1], {"a": 1})
_NAMES = (
    "own.dat", "x", "notes.txt", "evaluate_x.json", "yield_x.json", "compare_zz.json", "evaluate_.json", "lens.png",
    ".lensforge-lock", ".lensforge-writing-1.json", "checkpoint.bin", "yield_parts.npz", "report.html", "a\nb.csv",
    "plate.step", "lens_surfaces.step", "photometry_x.json",
)  # fmt: skip


def new(path: Path) -> Path:
    """``path`` without what was there: the files of a case are hard links to those of all."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    return path


def swap(path: Path, chance: Chance) -> None:
    others = sorted(file for file in path.parent.iterdir() if file.is_file() and not file.is_symlink())
    other = chance.choice(others)
    content = other.read_bytes() if other.stat().st_size < 2**26 else b""
    new(path).write_bytes(content)


def damage(path: Path, chance: Chance) -> None:
    content = bytearray(
        path.read_bytes() if path.is_file() and not path.is_symlink() and path.stat().st_size < 2**26 else b"{}"
    )
    for _ in range(chance.randint(1, 4)):
        place = chance.randrange(len(content) + 1)
        content[place : place + chance.choice((0, 1, 40))] = chance.choice(
            (b"", b"\0", b"\xff" * 9, b"nan", b"[" * 3000)
        )
    new(path).write_bytes(content)


def link(path: Path, chance: Chance) -> None:
    inside = sorted(path.parent.iterdir())
    aims = (path.parent.parent / "secret", "/dev/zero", "/nowhere", path.name, "/proc/self/mem", chance.choice(inside))
    new(path).symlink_to(chance.choice(aims))


def hard_link(path: Path, chance: Chance) -> None:
    """A second name of a file: no program can tell it from the first."""
    new(path).hardlink_to(path.parent.parent / "elsewhere")


def pipe(path: Path, chance: Chance) -> None:
    os.mkfifo(new(path))


def folder(path: Path, chance: Chance) -> None:
    new(path).mkdir()
    (path / "within.json").write_text("{}")


def sparse(path: Path, chance: Chance) -> None:
    new(path).touch()
    os.truncate(path, chance.choice((0, 2**20, 2**30 + 1, 2**43)))


def gone(path: Path, chance: Chance) -> None:
    new(path)


def forge(path: Path, chance: Chance) -> None:
    """One figure changed, and the checksum with it."""
    records = [
        file
        for file in sorted(path.parent.glob("*.json"))
        if not file.is_symlink() and file.is_file() and file.stat().st_size < 2**22
    ]
    if not records:
        return
    record = path if path in records else chance.choice(records)
    try:
        content = json.loads(record.read_bytes())
    except (ValueError, RecursionError, OSError):
        return
    if isinstance(content, dict) and content:
        key = chance.choice(sorted(content))
        new(record).write_text(json.dumps(with_checksum({**content, key: changed(content[key], chance)})))


def changed(value: Any, chance: Chance) -> Any:
    """``value`` with one of its leaves or branches changed."""
    if isinstance(value, dict) and value and chance.random() < 0.95:
        key = chance.choice(sorted(value))
        return {**value, key: changed(value[key], chance)}
    if isinstance(value, list) and value and chance.random() < 0.95:
        place = chance.randrange(len(value))
        return [*value[:place], changed(value[place], chance), *value[place + 1 :]]
    number = isinstance(value, float | int) and chance.random() < 0.6
    return value * chance.choice((0.5, 1.001, 2.0, -1.0)) if number else chance.choice(_WORDS)


CHANGES: tuple[Callable[[Path, Chance], None], ...] = (
    swap, damage, link, hard_link, pipe, folder, sparse, gone, forge, forge, forge,
)  # fmt: skip


def made(whole: Path, place: Path, chance: Chance) -> Path:
    """A folder with one to three changes."""
    shutil.rmtree(place, ignore_errors=True)
    copied(whole, place, copy_function=os.link, symlinks=True)
    for _ in range(chance.randint(1, 3)):
        names = sorted(path.name for path in place.iterdir())
        name = chance.choice(names if chance.random() < 0.7 else _NAMES)
        chance.choice(CHANGES)(place / name, chance)
    if chance.random() < 0.3:
        new(place / "run.json")
    return place


def read(place: Path) -> object:
    run = lf.load(place)
    for stem in ("evaluate", "verify", "stray"):
        if stem in run.found:
            stated = json.loads((place / f"{stem}.json").read_text())["efficiency"]
            assert stated == json.loads(json.dumps(run.found[stem].plain()["efficiency"])), stem
    return run.row()


def shown(place: Path) -> object:
    return existing(place).to_show().verdict


def renewed(place: Path) -> None:
    """What every command of a stage does beside its work."""
    with opened(place) as here:
        here.renew()
        here.refresh_report()


def commands(number: int) -> list[Callable[[Path], object]]:
    """What is done with a folder: those that take long with few of them."""
    every: list[tuple[Callable[[Path], object], int]] = [(read, 1), (shown, 4), (renewed, 5), (write_report, 24)]
    return [command for command, often in every if number % often == 0]


@pytest.mark.filterwarnings("error")
def test_a_folder_is_read_or_refused_in_one_line(whole_run: lf.Run, tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(SECRET)
    (tmp_path / "elsewhere").write_bytes(b"{}")
    told = hashlib.sha256(SECRET).hexdigest()
    for number in range(scaled(60, by_day=12)):
        place = made(whole_run.folder, tmp_path / "run", Chance(number))
        for command in commands(number):
            try:
                command(place)
            except lf.InputError:
                one_line(pytest.ExceptionInfo.from_current())
            except Exception as error:
                raise AssertionError(f"case {number}: {command.__name__}") from error
        page = place / "report.html"
        if not page.is_symlink() and page.is_file() and page.stat().st_size < 2**26:
            assert told not in page.read_text(encoding="utf-8", errors="replace"), number
