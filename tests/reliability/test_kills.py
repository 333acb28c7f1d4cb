"""Commands killed at random moments end, once they go on, in the files of commands that nobody killed."""

import json
from pathlib import Path

import pytest
from kills import DESIGN, SWEEP, differences, killed, uninterrupted


@pytest.mark.nightly("minutes")
@pytest.mark.parametrize("commands", [DESIGN, SWEEP], ids=["design", "sweep"])
def test_killed_commands_end_in_the_same_bits(commands: tuple[tuple[str, ...], ...], tmp_path: Path) -> None:
    (one, seconds), (two, _) = (uninterrupted(tmp_path / name, commands) for name in ("one", "two"))
    assert one.failures == two.failures == differences(two.files(), one.files(), two.files()) == []
    for seed in range(1, 9):
        outcome = killed(tmp_path / f"killed-{seed}", seed, commands, seconds, most=3, of_one=8)
        assert outcome.failures + differences(outcome.files(), one.files(), two.files()) == []
        if outcome.kills:
            return
    pytest.fail("no kill came before the command had ended")


def test_what_differs_is_seen() -> None:
    """A file more or less, another bit of a file, another value of a record; computing times do not count."""
    record = {"nmse": 0.25, "seconds": 1.0, "content_sha256": "a"}
    pages = (b"<p>1.0 s</p>\n<p>0.25</p>", b"<p>2.0 s</p>\n<p>0.25</p>")
    wanted = {"a.json": json.dumps(record).encode(), "b.npz": b"01", "c.html": pages[0]}
    again = wanted | {"c.html": pages[1]}

    def seen(**change: bytes) -> list[str]:
        names = {"a": "a.json", "b": "b.npz", "c": "c.html", "left": ".lensforge-writing-x"}
        return differences(wanted | {names[key]: value for key, value in change.items()}, wanted, again)

    times = record | {"seconds": 9.0, "content_sha256": "b"}
    assert seen() == seen(a=json.dumps(times).encode(), c=b"<p>7.0 s</p>\n<p>0.25</p>") == []
    assert seen(a=json.dumps(record | {"nmse": 0.5}).encode()) == ["other bits: a.json"]
    assert seen(b=b"00") == ["other bits: b.npz"]
    assert seen(c=b"<p>1.0 s</p>\n<p>0.5</p>") == seen(c=pages[0] + b"\n") == ["other bits: c.html"]
    one, two = (b"<p>on 2026-11-23 20:07 UTC, 1.5 s</p>\n<i>%d</i>" % digit for digit in (0, 9))
    page = b"<p>on 2026-11-23 20:08 UTC, 1.7 s (stages can run side by side)</p>\n<i>1</i>"
    assert differences({"c.html": page}, {"c.html": one}, {"c.html": two}) == []
    assert differences({"c.dxf": b"1"}, {"c.dxf": b"0"}, {"c.dxf": b"1"}) == ["other bits: c.dxf"], "each time another"
    assert seen(left=b"") == ["left over: .lensforge-writing-x"]
    assert differences({}, {"b.npz": b"01"}, {"b.npz": b"01"}) == ["missing: b.npz"]
