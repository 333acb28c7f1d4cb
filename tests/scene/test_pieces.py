"""Light of many rays in pieces, one after another or on several threads, is that of all at once, ray by ray."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_housing import BOX, TUBE, from_point, housing_of
from test_posed import RECEIVERS, exits

from lensforge.scene import body_view, housing, receiver, target_pattern
from lensforge.scene.body_view import BodyView
from lensforge.scene.receiver_shapes import Plane
from lensforge.scene.target_pattern import drawn_target
from lensforge.spec.shape_targets import RingTarget

RAYS = exits(500)
FROM_POINT = from_point(500)


def shadow() -> tuple[np.ndarray, ...]:
    """Beside soft rims, so that rays that pass by are dimmed, too."""
    soft = replace(housing_of(BOX, TUBE), rim=0.2)
    seen = soft.shadow(FROM_POINT.points, FROM_POINT.directions, np.full(500, 200.0))
    return seen.onward, seen.triangles, seen.bodies


def landings(name: str) -> tuple[np.ndarray, ...]:
    landed = RECEIVERS[name].land(RAYS)
    return landed.hits, landed.flux, landed.landed


def sensitivities(name: str) -> tuple[np.ndarray, ...]:
    landed = RECEIVERS[name].land(RAYS).landed[:, None]
    by = RECEIVERS[name].sensitivities(RAYS, np.random.default_rng(1).normal(size=(500, 2)) * landed)
    return by.by_points, by.by_directions


def in_target() -> tuple[np.ndarray, ...]:
    plane = RECEIVERS["plane on the axis"]
    assert isinstance(plane, Plane)
    ring = RingTarget(outer_diameter_mm=50.0, inner_diameter_mm=21.0, centre_mm=(17.0, 28.0))
    hits = np.random.default_rng(0).uniform(-60.0, 60.0, (500, 2))
    return (drawn_target((ring,), plane).contains(hits),)


CASES: dict[str, Callable[[], tuple[np.ndarray, ...]]] = {
    "shadow": shadow,
    "target": in_target,
    "body": lambda: BodyView.of(TUBE.changed(patch_mm=4.0)).met(FROM_POINT.points, FROM_POINT.directions),
    **{f"land on {name}": lambda name=name: landings(name) for name in ("plane", "far field", "cylinder", "sphere")},
    **{f"gradient on {name}": lambda name=name: sensitivities(name) for name in ("plane", "cylinder", "sphere")},
}


@pytest.mark.parametrize("name", CASES)
def test_pieces_of_rays_have_the_light_of_all_of_them(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = CASES[name]()
    assert any(len(np.unique(column)) > 1 for column in whole), "some rays are told from others"

    def by_sevens(work: Callable[[slice], Any], count: int, *, worth: int) -> None:
        for start in reversed(range(0, count, 7)):
            work(slice(start, min(start + 7, count)))

    for module in (body_view, housing, receiver, target_pattern):
        monkeypatch.setattr(module, "in_pieces", by_sevens)
    for column, other in zip(whole, CASES[name](), strict=True):
        np.testing.assert_array_equal(column, other)
