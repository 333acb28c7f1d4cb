"""docs/limits.md: it has every trade, and its limits on spill light hold a window to the intensities towards it."""

import re
import tomllib
from typing import Any

import numpy as np
import pytest
from page_sources import ROOT, blocks
from presets import FEW
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.light.evaluation_result import Light
from lensforge.spec.trades import TRADES

PAGE = ROOT / "docs" / "limits.md"
AWAY_M = 9.0
LM_PER_W = 300.0


def test_the_page_has_every_trade_in_its_table_and_in_its_example() -> None:
    part = PAGE.read_text(encoding="utf-8").partition("## Figures of a trade")[2].partition("\n## ")[0]
    rows = (row.partition(" | ")[0] for row in re.findall(r"^\| (`.*)", part, flags=re.MULTILINE))
    in_table = [name for row in rows for name in re.findall("`([^`]+)`", row) if name != "application"]
    (named,) = re.findall(r'^application = "(\w+)" +# (.*)$', part, flags=re.MULTILINE)
    assert sorted(in_table) == sorted(TRADES) == sorted(named[1].split(", "))
    assert named[0] in TRADES


def of_page() -> dict[str, Any]:
    """The block of the page, read as a spec."""
    (block,) = (block for block in blocks("toml", pages=[PAGE]) if '"windows"' in block.text)
    return tomllib.loads(block.text)


def light_with(windows_lx: float, road_cd: float) -> Light:
    part = of_page()
    for limit, bound in zip(part["limits"], (windows_lx, road_cd), strict=True):
        limit["at_most"] = bound
    source = {"kind": "square", "side_mm": 1.0, "flux_lm": 900.0, "luminous_efficacy_lm_per_w": LM_PER_W}
    spec = small_spec(target=None, source=source, **part)
    lens = lf.Lens.double(random_surface(1, 3.0), random_surface(2, 6.0), spec, 3, FEW)
    return lf.evaluate(lens, rays=2**18, pixels=64)


def window_by_intensities(light: Light) -> np.ndarray:
    """Illuminance of the pixels of the windows: I cos ε/d² of the intensity on the far field's nearest pixel."""
    windows, sky = light.receivers[1], light.receivers[2]
    rows, columns = windows.map.shape
    across = ((np.arange(columns) + 0.5) / columns - 0.5) * 8.0 + 1.0  # x of the lens
    along = ((np.arange(rows) + 0.5) / rows - 0.5) * 3.0
    x, up = np.meshgrid(across, along)
    z = 2.5 - up  # y of the plane leads towards the lamp: z is turned to -y
    away = np.sqrt(x**2 + AWAY_M**2 + z**2)
    gamma = np.arccos(z / away)
    chart = 2.0 * np.sin(0.5 * gamma)
    turn = np.arctan2(AWAY_M, x)
    side = len(sky.map)
    column, row = (((chart * part(turn) / sky.width + 0.5) * side).astype(int) for part in (np.cos, np.sin))
    return LM_PER_W * sky.map[row, column] * AWAY_M / away**3


def test_windows_get_what_the_intensities_towards_them_say() -> None:
    light = light_with(2.0, 500.0)
    lux = LM_PER_W * light.receivers[1].map
    by_hand = window_by_intensities(light)
    assert lux.mean() == pytest.approx(by_hand.mean(), rel=0.03)
    halves = [half.mean() for half in np.array_split(lux, 2)]
    assert halves == pytest.approx([half.mean() for half in np.array_split(by_hand, 2)], rel=0.05)
    assert halves[0] != pytest.approx(halves[1], rel=0.15), "so that up and down are told apart"


def test_each_limit_on_spill_light_is_judged_by_its_number() -> None:
    windows, road = (limit.value for limit in light_with(2.0, 500.0).limits)
    for factor, states in ((1.3, ["pass", "pass"]), (0.7, ["fail", "fail"])):
        judged = light_with(factor * windows, factor * road).limits
        assert [limit.state for limit in judged] == states
        assert [limit.value for limit in judged] == [windows, road]
