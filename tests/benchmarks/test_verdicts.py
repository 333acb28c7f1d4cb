"""Lenses on which the bounds of the verdict are calibrated: what is known of them without a search."""

import json
from pathlib import Path

import pytest
import verdicts
from known_refraction import normal_transmittance

import lensforge as lf
from lensforge.light.receiver_light import LEAST_SHARE
from lensforge.search.scene_check import SceneCheck
from lensforge.sources.build_source import build_source


def test_every_shipped_spec_is_run_and_ends_as_a_command_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {path.relative_to(verdicts.EXAMPLES).as_posix() for path in verdicts.EXAMPLES.rglob("*.toml")}
    assert {f"{name}.toml" for name in verdicts.shipped()} == files and "published/street" in verdicts.shipped()
    for name in ("KEPT", "FOLDERS"):
        monkeypatch.setattr(verdicts, name, tmp_path / getattr(verdicts, name).name)
    unread = tmp_path / "unread.toml"
    unread.write_text("[lens]\ncolour = 1\n", encoding="utf-8")
    monkeypatch.setattr(verdicts, "shipped", lambda: {"unread": unread})
    assert verdicts.run_shipped(["unread"]) == 1
    kept = json.loads(verdicts.KEPT.read_text(encoding="utf-8"))["unread"]
    assert kept["exit"] == 2 and kept["light"] == "" and "constraints: missing" in kept["said"]
    assert "| unread | 2 |  |  |  |" in verdicts.shown({"unread": kept})


def test_no_lens_brings_the_light_of_the_large_source_into_the_small_far_rectangle() -> None:
    """Étendue alone leaves less than the verdict asks for: it fails whatever the search finds."""
    spec = dict(verdicts.useless())["3 mm COB onto 60 x 40 mm at 500 mm"]
    assert isinstance(spec, lf.Spec)
    possible = SceneCheck.of(spec, build_source(spec.source)).targets[0].bounds.value
    assert possible < 0.3 < LEAST_SHARE * normal_transmittance(spec.lens.refractive_index) ** 2
