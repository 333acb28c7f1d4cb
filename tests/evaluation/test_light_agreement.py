"""A light agrees with its own pictures, whatever its window; one whose share was changed does not."""

import pytest
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.agreement.light import light_contradictions

RECEIVER_MM = 100.0


def light_of(window_mm: float) -> tuple[lf.Light, lf.Lens]:
    spec = small_spec(evaluate__window_mm=window_mm, target__receiver_mm=RECEIVER_MM, target__uniform_mm=None)
    lens = lf.Lens(random_surface(1, 3.0), random_surface(2, 6.0), spec, 0, "draft")
    return lf.evaluate(lens, rays=2**14), lens


@pytest.mark.parametrize("window_mm", [0.5 * RECEIVER_MM, RECEIVER_MM, 1.5 * RECEIVER_MM])
def test_a_light_agrees_with_its_pictures(window_mm: float) -> None:
    light, lens = light_of(window_mm)
    assert list(light_contradictions(light, lens)) == []


def test_a_share_that_its_pictures_do_not_show_is_named() -> None:
    light, lens = light_of(RECEIVER_MM)
    share = light.share_in_target
    changed = light.model_copy(update={"share_in_target": share.model_copy(update={"value": 0.9 * share.value})})
    assert [words.split(" =")[0] for words in light_contradictions(changed, lens)] == ["share_in_target"]
