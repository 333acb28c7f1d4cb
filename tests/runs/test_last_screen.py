"""The screen at the end of a run: its size, its columns, and the same as JSON."""

import json
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner, Result
from scenes import small_spec

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.cli.conclusion import document, rows_of, summary
from lensforge.cli.output import Block, print_screen
from lensforge.cli.preview_picture import PreviewPicture
from lensforge.cli.progress import duration
from lensforge.report.headline import required_facts
from lensforge.results import Fact, Group
from lensforge.results.child_pool import IN_TURN, child_pool
from lensforge.search import searches


def invoked(*arguments: object) -> Result:
    return CliRunner().invoke(cli, list(map(str, arguments)))


def printed(run: lf.Run, capsys: pytest.CaptureFixture[str]) -> str:
    print_screen(summary(run))
    return capsys.readouterr().out


def test_a_run_ends_in_one_screen(small_run: lf.Run, capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(small_run, capsys).splitlines()
    assert len(lines) <= 30, "a pipe has each line whole"
    for title in ("Photometry: ", "Lens: ", "CAD files: ", "Manufacture: ", "Written: "):
        assert any(line.startswith(title) for line in lines), title
    assert f"Photometry: {small_run.verdict.light}" in lines


def test_rows_of_the_screen_are_facts_of_the_records_and_files_of_the_folder(small_run: lf.Run) -> None:
    facts = [fact for result in small_run.found.values() for group in small_run.facts(result) for fact in group.facts]
    sentences: dict[str, set[str]] = {}
    for fact in facts:
        sentences.setdefault(fact.label, set()).add(fact.sentence)
    rows = [(block.title.partition(":")[0], *row) for block in summary(small_run) for row in block.rows]
    seen = [(label, text) for title, label, text in rows if label in sentences]
    assert len(seen) > 12 and all(text.partition(". Change:")[0] in sentences[label] for label, text in seen), rows
    (written,) = (text for _, label, text in rows if label == "Files")
    names = written.split(", ")
    assert {f"lens{name.removeprefix('lens')}" for name in names} <= {path.name for path in small_run.folder.iterdir()}
    assert {"lens.step", ".stl", ".3mf", ".ies", ".ldt"} <= set(names), written


def test_the_same_numbers_as_json_with_all_digits(small_run: lf.Run) -> None:
    content = json.loads(json.dumps(document(small_run, *small_run.found.values())))
    assert content["verdict"]["light"] == small_run.verdict.light
    stored = json.loads((small_run.folder / "evaluate.json").read_text(encoding="utf-8"))
    assert content["evaluate"] == {key: stored[key] for key in content["evaluate"]}
    light = next(group for group in content["facts"]["evaluate"] if group["key"] == "light")
    nmse = next(fact for fact in light["facts"] if fact["key"] == "nmse")
    assert (nmse["value"], nmse["standard_error"]) == (stored["nmse"]["value"], stored["nmse"]["standard_error"])


def test_limits_that_are_not_held_are_told_with_their_state_and_all_are_counted() -> None:
    limit = partial(Fact, unit="lx", sense=">=", limit=40.0)
    facts = [limit("a", "One", 43.7, state="pass"), limit("b", "Two", 39.1, standard_error=0.9, state="undecided")]
    facts += [limit(f"c{k}", f"Dark {k}", 12.5 + k, state="fail") for k in range(2)]
    first, *others = rows_of([Group("limits", "Limits", tuple(facts))])
    assert first == ("Limits", "1 of 4 met")
    assert [(name.strip(), text.split(" (")[0].replace("\u2009", " ")) for name, text in others] == [
        ("undecided", "Two: 39.10 ± 0.90 lx"), ("missed", "Dark 0: 12.5 lx"), ("missed", "Dark 1: 13.5 lx"),
    ]  # fmt: skip


def test_quiet_says_nothing_on_success(examples: Path) -> None:
    done = invoked("rays", examples / "led.tm25ray", "--quiet")
    assert (done.exit_code, done.output) == (0, "")
    done = invoked("rays", examples / "led.tm25ray", "--quiet", "--json")
    assert json.loads(done.stdout)["rays"] == 20_000


def test_labels_and_texts_stand_in_columns(capsys: pytest.CaptureFixture[str]) -> None:
    print_screen(
        [Block("Light: pass", [("NMSE", "0.1\u2009%"), ("A name\x1b[2J", "word " * 30)]), Block("Lens")], width=80
    )
    first, nmse, name, *rest = capsys.readouterr().out.splitlines()
    assert (first, rest[-1]) == ("Light: pass", "Lens")
    assert nmse.index("0.1 %") == name.index("word") == rest[0].index("word")
    assert "\x1b" not in name


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.04, "0.0 s"), (9.96, "10 s"), (59.6, "1 min 00 s"), (425.0, "7 min 05 s"), (4320.0, "1 h 12 min")],
)
def test_a_time_is_shown_in_two_units_at_most(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_a_pipe_is_not_wrapped_and_a_terminal_is(capsys: pytest.CaptureFixture[str]) -> None:
    text = "word " * 60
    block = Block("Title", [("Label", text)])
    print_screen([block])
    assert capsys.readouterr().out.splitlines() == ["Title", f"  Label  {text.strip()}"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdout.isatty", lambda: True)
        print_screen([block])
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80


def test_a_preview_has_light_and_picture_and_nothing_for_the_shop(tmp_path: Path) -> None:
    spec = small_spec(constraints__max_radius_mm=7.0)
    spec.save(tmp_path / "small.toml")
    opened: list[str] = []
    search = searches.design
    asked: list[bool] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("click.launch", opened.append)
        patch.setattr(searches, "design", lambda spec, **rest: asked.append(rest["preview"]) or search(spec, **rest))
        command = ["preview", str(tmp_path / "small.toml"), "--out", str(tmp_path / "first"), "--open"]
        result = CliRunner().invoke(cli, command)
    assert result.exit_code == 0, result.output
    assert asked == [True]
    written = {path.name for path in (tmp_path / "first").iterdir()}
    assert written == {"lens.json", "design.json", "evaluate.json", "evaluate.npz", "light.png", "run.json"}
    assert opened == [str(tmp_path / "first" / "light.png")] and "NMSE" in result.stdout and " ± " in result.stdout
    run = lf.load(tmp_path / "first")
    assert run.light.rays == 4096 and not hasattr(run, "part")


def test_the_picture_of_a_preview_is_there_after_the_first_level_and_outlasts_an_interrupt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small_spec(evaluate__rays=2**12).save(tmp_path / "small.toml")
    picture, search, seen, opened = tmp_path / "first" / "light.png", searches.design, [], list[str]()

    def interrupted(spec: lf.Spec, **options: Any) -> lf.Design:
        def heard(step: lf.Progress) -> None:
            time.sleep(1.0 if step.level_done else 0.0)  # no two pictures in a second
            options["progress"](step)
            seen.extend([picture.read_bytes()] if step.level_done else [])
            if len(seen) == 2:
                raise KeyboardInterrupt

        return search(spec, **{**options, "progress": heard})

    monkeypatch.setattr(searches, "design", interrupted)
    monkeypatch.setattr("click.launch", opened.append)
    result = invoked("preview", tmp_path / "small.toml", "--out", tmp_path / "first", "--open")
    assert result.exit_code != 0 and opened == [str(picture)], "shown once, as soon as it is there"
    first, second = seen
    assert first.startswith(b"\x89PNG") and second != first, "and renewed"
    assert [path.name for path in (tmp_path / "first").glob("[!.]*")] == ["light.png"]
    assert picture.read_bytes().endswith(b"IEND\xaeB`\x82"), "whole"


def test_the_pictures_of_a_preview_are_the_same_from_a_second_process(small_run: lf.Run, tmp_path: Path) -> None:
    level = SimpleNamespace(level_done=True, lens=lambda: small_run.lens)
    with child_pool(1, pytest.fail) as second:
        beside = PreviewPicture(tmp_path / "beside.png", second, shown=False)
        beside.on_step(level)
        beside.on_step(level)  # before the first is there: not drawn
        deadline = time.monotonic() + 60.0
        while not (tmp_path / "beside.png").exists():
            assert time.monotonic() < deadline
            time.sleep(0.02)
        on_the_way = (tmp_path / "beside.png").read_bytes()
        light = beside.at_the_end(small_run.lens)
    here = PreviewPicture(tmp_path / "here.png", IN_TURN, shown=False)
    here.on_step(level)
    assert (tmp_path / "here.png").read_bytes() == on_the_way
    assert here.at_the_end(small_run.lens).sha256 == light.sha256
    assert (tmp_path / "here.png").read_bytes() == (tmp_path / "beside.png").read_bytes() != on_the_way


def test_a_preview_takes_fewer_rays_than_a_draft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def search(spec: lf.Spec, **_: object) -> lf.Design:
        raise lf.InputError(f"{spec.evaluate.rays} rays")

    monkeypatch.setattr(searches, "design", search)
    small_spec(evaluate__rays=2**20).save(tmp_path / "small.toml")
    result = invoked("preview", tmp_path / "small.toml", "--out", tmp_path / "first")
    assert str(result.exception) == "131072 rays"


def first_level(preview: bool) -> list[float]:
    """The error at each step of the first level of a draft, which then ends."""
    seen: list[float] = []
    with pytest.raises(lf.Cancelled):
        searches.design(
            small_spec(lens__levels="auto", optimise={}),
            accuracy="draft",
            preview=preview,
            progress=lambda step: seen.append(step.nmse) or not step.level_done,
        )
    return seen


def test_a_preview_takes_fewer_steps_than_a_draft_from_the_same_start() -> None:
    first, whole = first_level(True), first_level(False)
    assert (len(first), len(whole)) == (25, 40) and first[0] == whole[0]


def test_the_screen_and_the_page_begin_with_the_figures_of_the_trade(small_run: lf.Run) -> None:
    """A torch: the brightest place of its light, then what its photometry says, each once."""
    brightest = Fact("a", "Brightest place", 12.5, "lx", 0.5, note="light of the brightest place", place="light")
    assert small_run.light is not None
    light = small_run.light.changed(figures=(brightest,))
    lens = replace(small_run.lens, spec=small_run.lens.spec.replace(application="torch"))
    run = lf.Run(lens, {**small_run.found, "evaluate": light}, {}, {}, folder=small_run.folder)
    (block,) = (block for block in summary(run) if block.title.startswith("Photometry"))
    labels = [label for label, _ in block.rows]
    first = ["Brightest place", "Peak intensity", "Beam angle, C 0", "Field angle, C 0"]  # no lumens, no throw
    assert labels[:4] == first and labels.count("Peak intensity") == 1
    assert "Pattern error (NMSE)" in labels[4:]
    assert [fact.label for fact in required_facts(run)][:4] == first
