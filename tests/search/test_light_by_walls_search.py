"""A search that sees the light of a mirror brings light around a corner, where one that is blind to it cannot."""

from typing import Any

import pytest
from presets import FEW
from scenes import small_spec

import lensforge as lf
from lensforge.light.lens_light import searched_source
from lensforge.scene.receiver import PosedReceiver
from lensforge.search.optimiser import search
from lensforge.spec import Spec

SCREEN = {"kind": "box", "name": "screen", "size_mm": [4.0, 120.0, 40.0], "centre_mm": [-32.0, 0.0, 20.0]}
MIRROR: dict[str, Any] = {
    "kind": "box", "name": "mirror", "size_mm": [160.0, 160.0, 2.0], "centre_mm": [-40.0, 5.0, 118.0],
    "tilt_deg": [4.0, 12.0], "surface": "mirror", "reflectance": 0.9,
}  # fmt: skip
AROUND_A_CORNER = {
    "kind": "plane", "centre_mm": [-110.0, 10.0, 50.0], "tilt_deg": [0.0, -90.0], "width_mm": 100.0,
    "height_mm": 100.0, "targets": [{"kind": "disc", "diameter_mm": 40.0, "edge_mm": 6.0}],
}  # fmt: skip


def efficiency(spec: Spec) -> float:
    """Of the lens that a search ends with, by an evaluation, in which walls reflect."""
    lens = search(spec, searched_source(spec), accuracy=FEW).lens
    (case,) = lf.evaluate(lens, rays=2**14).cases("receivers")
    return case.record.efficiency.value


def test_a_search_that_sees_a_mirror_brings_light_around_a_corner(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = small_spec(
        scene=[SCREEN, MIRROR], target=None, receivers=[AROUND_A_CORNER], lens__levels=[9],
        optimise__steps_per_level=[200], optimise__rays=512,
    )  # fmt: skip
    seen = efficiency(spec)
    of_search = PosedReceiver.searched
    monkeypatch.setattr(PosedReceiver, "searched", lambda receiver, *how: of_search(receiver.before_black, *how))
    assert seen > 0.15 > 0.06 > efficiency(spec)
