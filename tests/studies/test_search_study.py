"""What functions and steps gain: the study of a search, against the search itself."""

from dataclasses import replace

import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.runs.tradeoff.search import search_study
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS, SearchEffort

FEW = SearchEffort(25, (4, 6), (256, 512), 512, 0.5, 0.0)


@pytest.mark.nightly("searches of every level, 12 s")
def test_levels_are_those_of_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PRESETS, "draft", replace(PRESETS["draft"], effort=FEW))
    spec = small_spec(optimise__uniformity_steps=2)
    design = lf.design(spec.with_automatic_levels(), accuracy="draft")
    study = search_study(spec, build_source(spec.source), "draft", 2**12)
    *levels, reference = study.levels
    assert reference.reference
    assert [level.setting for level in levels[:2]] == [9, 34]
    assert [level.other["steps"] for level in levels[:3]] == [4, 8, 14]
    assert levels[-1].other["steps"] == design.steps
    seconds = [float(level.seconds or 0.0) for level in levels]
    assert seconds == sorted(seconds) and seconds[0] > 0.0
    light = lf.evaluate(design.lens, rays=2**12)
    losses = [level.errors["loss"].value for level in levels]
    assert min(losses, key=lambda loss: abs(loss - 1.0 + light.efficiency.value)) == pytest.approx(
        1.0 - light.efficiency.value, abs=1e-3
    ), "the search ends with the lens of one of its stages"
    for level in levels:
        assert 0.0 < level.errors["form"].value < 50.0, "nm: the export's own limit holds at every level"
        assert level.other["inner_concave_mm"] > 0.0
