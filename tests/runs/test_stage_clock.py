"""Lines of the stages on stderr: on a terminal with a clock, in a pipe once each has ended."""

import inspect
import re
import time

import pytest

from lensforge.cli.progress import PartsProgress, StageClock


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal of 60 columns in the place of stderr."""
    for name, value in {"FORCE_COLOR": "1", "COLUMNS": "60", "TERM": "xterm"}.items():
        monkeypatch.setenv(name, value)


def frames(written: str) -> list[str]:
    """What the terminal has shown, line by line, without its controls."""
    return [
        line
        for part in re.split(r"\r\n|\n|\r|\x1b\[2K", written)
        if (line := re.sub(r"\x1b\[[?0-9;]*[A-Za-z]", "", part)).strip()
    ]


def test_a_pipe_gets_a_line_for_each_stage_that_has_ended(capsys: pytest.CaptureFixture[str]) -> None:
    with StageClock("design") as clock:
        assert capsys.readouterr().err == "", "it has not ended"
        clock.begin("evaluate")
        assert capsys.readouterr().err.split() == ["design", "0.0", "s"]
        clock.show("half of it")
    assert capsys.readouterr().err.split() == ["evaluate", "0.0", "s", "half", "of", "it"]


def test_a_stage_that_fails_has_no_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="bad"), StageClock("design"):
        raise ValueError("bad")
    assert capsys.readouterr().err == "", "the message alone says it"


def test_quiet_says_nothing_but_warnings(capsys: pytest.CaptureFixture[str], terminal: None) -> None:
    with StageClock("yield", quiet=True) as clock:
        clock.begin("parts")
        clock.note("a word")
        clock.warn("a source without flux")
    assert frames(capsys.readouterr().err) == ["warning: a source without flux"]


def test_brackets_of_a_message_are_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    """Tables of a spec stand in brackets, and a spec may name a thing by a tag of the terminal."""
    message = "[limits] of [lens.inner]: [red]lamp[/red] and [/]"
    with StageClock("yield") as clock:
        clock.note(message)
        clock.warn(message)
    assert frames(capsys.readouterr().err)[:2] == [message, f"warning: {message}"]


def test_the_clock_of_a_terminal_goes_on_by_itself_in_60_columns(
    capsys: pytest.CaptureFixture[str], terminal: None
) -> None:
    with StageClock("design") as clock:
        clock.show("level 4, NMSE 0.0045, 12 min 05 s left, " + 10 * "and more ")
        time.sleep(1.2)
    shown = frames(capsys.readouterr().err)
    assert max(map(len, shown)) <= 60
    times = [re.search(r"([\d.]+) s ", line) for line in shown]
    assert len({match.group(1) for match in times if match}) >= 3, "it stands still"
    assert "0.0045" in shown[-1], "the line that stays"


def test_a_long_stage_writes_a_line_a_minute_into_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    assert inspect.signature(StageClock).parameters["silent_s"].default == 60.0
    with StageClock("yield", silent_s=0.05) as clock:
        PartsProgress(clock).on_parts(3, 40)
        time.sleep(0.3)
    assert len([line for line in capsys.readouterr().err.splitlines() if line.endswith("3 of 40 parts")]) >= 3


def test_a_line_in_between_puts_off_the_one_of_a_long_stage(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another stage ends 20 s before the minute is over: the next line is due 40 s later."""
    clock = StageClock("yield", silent_s=60.0)
    clock.begin("yield")
    clock.begin("export", beside=True)
    waits = list[float]()

    def wait(seconds: float) -> bool:
        waits.append(seconds)
        if len(waits) == 1:
            monkeypatch.setattr("lensforge.cli.progress.time.monotonic", lambda: written + 40.0)
            clock.end("export")
        monkeypatch.setattr("lensforge.cli.progress.time.monotonic", lambda: written + sum(waits))
        return len(waits) == 3

    written = clock._written
    monkeypatch.setattr("lensforge.cli.progress.time.monotonic", lambda: written)
    monkeypatch.setattr(clock._exited, "wait", wait)
    clock._write_until_exit()
    assert waits == pytest.approx([60.0, 40.0, 60.0])
    assert [line.split()[0] for line in capsys.readouterr().err.splitlines()] == ["export", "yield"]


def test_a_study_says_once_in_a_pipe_how_long_it_takes(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the pace after the first call, which may have parts of an interrupted study: 4 of them in 20 s."""
    with StageClock("yield") as clock:
        progress = PartsProgress(clock)
        for seconds, done in ((100.0, 10), (100.0, 10), (120.0, 14), (140.0, 18), (150.0, 20)):
            monkeypatch.setattr("lensforge.cli.progress.time.monotonic", lambda now=seconds: now)
            progress.on_parts(done, 50)
        monkeypatch.undo()
    lines = [line for line in capsys.readouterr().err.splitlines() if "left" in line]
    assert lines == ["14 of 50 parts, at least 3 min 00 s left"]


def test_the_amounts_of_a_budget_are_one_stage(capsys: pytest.CaptureFixture[str]) -> None:
    with StageClock("yield") as clock:
        progress = PartsProgress(clock)
        for stage in ("parts", "budget: 1 of 3, source height", "budget: 2 of 3, index", "worst parts"):
            progress.on_stage(stage)
            progress.on_parts(14, 50)
    lines = capsys.readouterr().err.splitlines()
    assert [line[:12].strip() for line in lines] == ["yield", "parts", "budget", "worst parts"]
    assert lines[1].endswith(" 14 of 50 parts") and lines[3].endswith(" 14 of 50 parts")
    assert lines[2].endswith("2 of 3, index: 14 of 50 parts"), "how many rounds follow"
