"""What the page of the studio gets of a step of a search."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.addons.studio import search_watch
from lensforge.addons.studio.search_watch import SearchWatch

PLANE = {"kind": "plane", "name": "wall", "centre_mm": [0.0, 0.0, 80.0], "width_mm": 100.0, "height_mm": 60.0}
TARGETS = [{"kind": "rectangle", "width_mm": 50.0, "height_mm": 30.0}]
SKY = {"kind": "far_field", "name": "sky", "half_angle_deg": 60.0, "targets": [{"kind": "beam", "fwhm_deg": 40.0}]}


def test_light_and_target_of_each_receiver_are_in_one_unit_and_of_one_flux(monkeypatch: pytest.MonkeyPatch) -> None:
    """The light by area or by solid angle, in lumens; the pattern that is wanted has as much of it."""
    source = {"kind": "square", "side_mm": 1.0, "flux_lm": 200.0, "luminous_efficacy_lm_per_w": 250.0}
    receivers = [{**PLANE, "targets": TARGETS}, SKY]
    spec = small_spec(source=source, target=None, receivers=receivers, optimise__pixels=24)
    lens = lf.Lens.double(random_surface(1, 3.0), random_surface(2, 6.0), spec, 0, "draft")
    sent: list[tuple[str, dict[str, np.ndarray], dict[str, Any]]] = []
    pipe = SimpleNamespace(
        asked="", figure="sag", warn=pytest.fail, send=lambda name, arrays, **told: sent.append((name, arrays, told))
    )
    monkeypatch.setattr(search_watch, "drawn", lambda *_: {})
    monkeypatch.setattr(SearchWatch, "_look_on", lambda _: None)
    watch = SearchWatch(pipe, spec)
    rng = np.random.default_rng(1)
    images = tuple(rng.random(target.shape) for target in watch._targets)
    step = SimpleNamespace(
        nmse=0.25, efficiency=0.5, level=2, images=images, lens=lambda: lens, tables=None, steps_done=3, steps_total=9,
        seconds=1.5,
    )  # fmt: skip
    assert watch.on_step(step) is None
    watch._look(step, images)
    assert watch.closed() is lens
    ((name, arrays, told),) = sent
    assert name == "step" and (told["level"], told["step"], told["steps"], told["seconds"]) == (2, 3, 9, 1.5)
    assert (arrays["nmse"].tolist(), arrays["efficiency"].tolist()) == ([0.25], [0.5])
    pixels_m2 = 1e-6 * 100.0 * 60.0 / watch._targets[0].size
    assert arrays["light0"] == pytest.approx(250.0 * images[0] / pixels_m2)
    for number, target in enumerate(watch._targets):
        light, wanted = arrays[f"light{number}"], arrays[f"target{number}"]
        assert wanted.sum() == pytest.approx(light.sum()) and wanted == pytest.approx(target * light.sum())
