"""A session by what it asks of its process: searches begun, resumed and refused, and the folder in which it writes."""

import asyncio
import json
import os
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.addons.studio import spec_text
from lensforge.addons.studio.search_job import JOB_FILE, SearchJob
from lensforge.addons.studio.session import Session
from lensforge.addons.studio.spec_text import SpecText
from lensforge.addons.studio.studio import _opened
from lensforge.search.checkpoint import CHECKPOINT
from lensforge.surfaces.imported_face import LENS_FILE

TEXT = "# my lens\n" + small_spec().to_toml()
Asked = list[tuple[str, dict[str, Any]]]


def session_on(folder: Path | None, text: str = TEXT, path: Path | None = None) -> tuple[Session, Asked]:
    """A session without a process, and what it would have asked of one."""
    session, asked = Session(SpecText.of(text, path or Path("lens.toml")), folder), Asked()
    session._send = lambda job, **more: asked.append((job, more))  # type: ignore[method-assign]
    return session, asked


def run(work: Callable[[], Any]) -> Any:
    async def in_loop() -> Any:
        result = work()
        return await result if asyncio.iscoroutine(result) else result

    return asyncio.run(in_loop())


def test_every_file_that_an_example_names_is_named_by_its_whole_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    example = tmp_path / "two_files.toml"
    example.write_text('[source]\nfile = "led.ray"\n[target]\nfile = "cat.png"\nname = "no file"\n', encoding="utf-8")
    for name in ("led.ray", "cat.png"):
        (tmp_path / name).touch()
    monkeypatch.setattr(spec_text, "shipped_specs", lambda: {"two_files": example})
    text = SpecText.of(TEXT, tmp_path / "lens.toml").from_example("two_files").text
    assert tomllib.loads(text) == {
        "source": {"file": str(tmp_path / "led.ray")}, "target": {"file": str(tmp_path / "cat.png"), "name": "no file"}
    }  # fmt: skip
    with pytest.raises(lf.InputError, match="examples other: not found; known: two_files"):
        SpecText.of(TEXT, tmp_path / "lens.toml").from_example("other")


def paused(folder: Path, **changes: object) -> None:
    """Leave a checkpoint and its record in ``folder``."""
    fields = {"text": TEXT, "accuracy": "standard", "seed": 7, "force": False, "start": True}
    SearchJob(**(fields | changes)).write(folder)  # type: ignore[arg-type]
    (folder / CHECKPOINT).write_bytes(b"checkpoint")


def test_go_on_resumes_the_same_text_and_searches_for_another(tmp_path: Path) -> None:
    paused(tmp_path)
    session, asked = session_on(tmp_path)
    run(session.go_on)
    [(job, resumed)] = asked
    assert (job, resumed["resume"], resumed["start"]) == ("search", True, True)
    assert (resumed["accuracy"], resumed["seed"], resumed["text"]) == ("standard", 7, TEXT), "those of its record"
    other = TEXT.replace("side_mm = 1.0", "side_mm = 1.5")
    assert other != TEXT
    session, asked = session_on(tmp_path, other)
    run(session.go_on)
    [(job, begun)] = asked
    assert (job, begun["resume"], begun["text"]) == ("search", False, other)
    (tmp_path / CHECKPOINT).unlink()
    session, asked = session_on(tmp_path)
    run(session.go_on)
    assert asked[0][1]["resume"] is False, "nothing to go on from"


def test_what_runs_is_not_begun_again(tmp_path: Path) -> None:
    paused(tmp_path)
    session, asked = session_on(tmp_path)
    session.tell(phase="searching")
    for refused in (session.go_on, session.make_part):
        with pytest.raises(lf.InputError, match="another job runs; stop it first"):
            refused()
    session.tell(phase="making")
    with pytest.raises(lf.InputError, match=r"^search: the part is being made; stop that first$"):
        session.search()
    session.tell(phase="idle")
    with pytest.raises(lf.InputError, match=r"^pause: nothing runs$"):
        session.ask("pause")
    with pytest.raises(lf.InputError, match=r"no lens in .*; search first"):
        session.make_part()
    assert asked == []


@pytest.mark.parametrize(
    "settings", [{"accuracy": "best"}, {"accuracy": ["draft"]}, {"seed": -1}, {"seed": 2**20 + 1}, {"seed": 1.5}]
)
def test_a_refused_setting_leaves_all_settings_as_they_were(settings: dict[str, Any], tmp_path: Path) -> None:
    session, asked = session_on(tmp_path)
    session.tell(asks=True, warnings=["a doubt"])
    before = dict(session.state)
    with pytest.raises(lf.InputError):
        session.search(force=True, **settings)
    with pytest.raises(lf.InputError, match=r"^figure 'weight': must be one of sag, slope"):
        session.colour_by("weight")
    assert (session.state, asked) == (before, [])


def deep(path: Path) -> None:
    path.write_bytes(b"[" * 200_000)


def pipe(path: Path) -> None:
    os.mkfifo(path)


def endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(60 * 2**30)


def record(**changes: object) -> Callable[[Path], None]:
    fields = {"text": TEXT, "accuracy": "draft", "seed": 0, "force": False, "start": False} | changes
    return lambda path: path.write_text(json.dumps(fields))  # type: ignore[return-value]


@pytest.mark.parametrize(
    "damage",
    [
        deep, pipe, endless, sparse, record(text=3), record(text="\ud800"), record(accuracy="best"), record(seed=1e999),
        record(seed=-1), record(seed=True), record(start="x"), record(force=None), lambda path: path.write_text("[]"),
        lambda path: path.write_text("null"), lambda path: path.write_bytes(b"\xff\xfe"), lambda path: path.mkdir(),
    ],
)  # fmt: skip
def test_a_damaged_record_of_a_search_is_one_line_and_none_goes_on(
    damage: Callable[[Path], None], tmp_path: Path
) -> None:
    (tmp_path / CHECKPOINT).write_bytes(b"checkpoint")
    damage(tmp_path / JOB_FILE)
    assert _opened(tmp_path).text == "", "as if there were none"
    session, asked = session_on(tmp_path)
    session._show_folder()
    assert session.state["phase"] == "idle"
    [line] = session.state["refused"]
    assert line.startswith(str(tmp_path / JOB_FILE)) and line.isprintable() and len(line) < 1000
    run(session.go_on)
    assert asked[0][1]["resume"] is False


def test_the_settings_of_a_search_that_may_go_on_are_shown(tmp_path: Path) -> None:
    paused(tmp_path)
    session, _ = session_on(tmp_path)
    session._show_folder()
    assert [session.state[name] for name in ("phase", "accuracy", "seed")] == ["paused", "standard", 7]
    assert _opened(tmp_path).text == TEXT


def test_results_go_to_the_folder_by_the_name_of_the_spec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = Path("cad_out/second")
    folder.mkdir(parents=True)
    (folder / LENS_FILE).write_text("{}")

    async def renamed() -> None:
        session, asked = session_on(None)
        first = session.folder
        named = TEXT.replace(f'name = "{small_spec().name}"', 'name = "second"')
        assert first == Path("cad_out") / small_spec().name and named != TEXT
        session.tell(phase="searching")
        await session.change(lambda text: text.with_text(named))
        assert session.folder == first, "a search stays where it is"
        session.tell(phase="idle")
        await session.change(lambda text: text.with_text(named))
        assert (session.folder, session.state["asks"], session.state["folder"]) == (folder, True, str(folder))
        assert ("look", {"folder": str(folder), "place": "own"}) in asked
        session.save()
        assert Path("second.toml").read_text() == named
        await session.change(lambda text: text.with_text(TEXT))
        assert session.folder == first and session.text.path == Path("second.toml"), "once saved it has its file"

    run(renamed)
    fixed, _ = session_on(tmp_path / "here")
    fixed._follow_name()
    assert fixed.folder == tmp_path / "here"


def test_save_writes_over_no_file_but_its_own(tmp_path: Path) -> None:
    path = tmp_path / "lens.toml"
    path.write_text("# of somebody else")
    session, _ = session_on(tmp_path, path=path)
    with pytest.raises(lf.InputError, match=r"lens\.toml: is there already; give the spec another name"):
        session.save()
    assert path.read_text() == "# of somebody else"


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_line_ends_of_dos_and_a_byte_order_mark_stay(mark: bytes, tmp_path: Path) -> None:
    path, dos = tmp_path / "lens.toml", TEXT.replace("\n", "\r\n")
    path.write_bytes(mark + dos.encode())
    opened = _opened(path)

    async def edited() -> None:
        session = Session(SpecText.of(opened.text, path), tmp_path, is_file=opened.is_file)
        assert session.text.text == dos
        await session.change(
            lambda text: text.with_text(TEXT.replace("# my lens", "# your lens"))
        )  # as a browser has it
        await session.change(lambda text: text.edited(("constraints", "max_radius_mm"), {"toml": "9.5"}))
        session.save()

    run(edited)
    content = path.read_bytes()
    assert content.startswith(mark + b"# your lens\r\n") and b"max_radius_mm = 9.5\r\n" in content
    assert content.count(b"\n") == content.count(b"\r\n") == dos.count("\n")


def test_a_text_that_takes_too_long_to_read_is_refused_and_the_next_one_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import time

    monkeypatch.setattr("lensforge.addons.studio.session._READING_S", 0.2)

    def slow(text: SpecText) -> SpecText:
        time.sleep(1.0)
        return text

    async def both() -> None:
        session, _ = session_on(tmp_path)
        with pytest.raises(lf.InputError, match=r"^the text takes more than 0\.2 s to read; shorten it$"):
            await session.change(slow)
        assert session.text.text == TEXT
        monkeypatch.setattr("lensforge.addons.studio.session._READING_S", 20.0)
        await session.change(lambda text: text.with_text("# other\n" + TEXT))
        assert session.text.text.startswith("# other\n")

    run(both)


def test_changes_that_come_together_are_made_one_after_another(tmp_path: Path) -> None:
    async def several() -> Session:
        session, _ = session_on(tmp_path)
        edits = [("constraints", "max_radius_mm", "9.5"), ("source", "flux_w", "2.5")]
        await asyncio.gather(*(session.change(lambda t, e=edit: t.edited(e[:2], {"toml": e[2]})) for edit in edits))
        return session

    text = run(several).text.text
    assert "max_radius_mm = 9.5" in text and "flux_w = 2.5" in text, "none is lost"


@pytest.mark.parametrize(("changed_at", "shown"), [("wanted", 0), ("bounds", 1), ("doubts", 3), ("", 4)])
def test_physics_of_a_text_that_has_changed_meanwhile_is_not_shown(changed_at: str, shown: int, tmp_path: Path) -> None:
    """Neither its picture nor its figures."""
    answers = {"wanted": b"picture", "bounds": {"rows": []}, "lens_kinds": {"options": []}, "doubts": {"warnings": []}}
    session, _ = session_on(tmp_path)

    async def answered(_: object, name: str, spec: object) -> object:
        if name == changed_at:
            session.text = SpecText.of("# other\n" + TEXT, Path("lens.toml"))
        return answers[name]

    session._in_thread = answered  # type: ignore[method-assign]
    run(lambda: session._physics(session.text))
    told = {name: session.frames.get(name, session.state.get(name)) for name in answers}
    assert [name for name, answer in told.items() if answer] == list(answers)[:shown]
